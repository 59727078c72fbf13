"""A camera as the reference of hand tracking (thesis, 7.4.2): joints of RGB-D images in the room, with their errors, and residuals."""
