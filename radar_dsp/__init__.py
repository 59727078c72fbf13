"""Raw frames to point clouds: spectrum, CFAR detection, direction of arrival."""

from radar_dsp.baseband import Baseband
from radar_dsp.config import BasebandConfig, CfarConfig, CouplingConfig, DoaConfig, SpectrumConfig, TdmConfig

__all__ = ["Baseband", "BasebandConfig", "CfarConfig", "CouplingConfig", "DoaConfig", "SpectrumConfig", "TdmConfig"]
