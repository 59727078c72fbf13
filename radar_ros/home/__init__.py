"""What a smart home is told of a room over MQTT: entities and their topics, and the connection to the broker."""
