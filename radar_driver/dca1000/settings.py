"""What a user can set of a sensor with a capture board."""

from __future__ import annotations

from typing import Literal

from radar_core import ConfigError, Pose
from radar_core.config import config, knob
from radar_driver.dca1000.packets import LARGEST
from radar_driver.dca1000.ti_config import TiConfig


@config
class Dca1000Config:
    """A TI sensor (xWR12xx, 14xx, 16xx, 18xx, 68xx) with a DCA1000EVM."""

    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()
    config: str = knob("", doc="the sensor's .cfg: what it is to measure")
    serial_port: str = knob("", doc="the sensor's command line, e.g. /dev/ttyACM0, or auto; empty: somebody else starts the sensor")
    control: bool = knob(
        True, doc="set up and start the capture board; off: somebody else does (mmWave Studio), its samples are listened to"
    )
    lanes: Literal[2, 4] = knob(2, doc="LVDS lanes: 2 for xWR16xx, 18xx and 68xx; 4 for xWR12xx and 14xx")
    order: Literal["q_first", "i_first"] = knob("q_first", doc="q_first: TI's demos; i_first: mmWave Studio; wrong mirrors the range")
    host_address: str = knob("192.168.33.30", doc="this computer's address on the capture board's network")
    board_address: str = knob("192.168.33.180", doc="the capture board's address")
    config_port: int = knob(4096, low=1, high=65535, doc="UDP port of its commands, on both sides")
    data_port: int = knob(4098, low=1, high=65535, doc="UDP port of its samples")
    packet_delay: float = knob(25e-6, unit="s", low=5e-6, high=500e-6, doc="pause of the capture board after each packet")
    timeout: float = knob(0.3, unit="s", low=0.01, high=10.0, doc="how long the capture board may take to answer; it is asked three times")
    cli_timeout: float = knob(3.0, unit="s", low=0.1, high=60.0, doc="how long the sensor may take for a line of the .cfg")
    silence: float = knob(1.0, unit="s", low=0.1, high=600.0, doc="without samples for so long (three frames at least) all is set up anew")
    min_received: float = knob(0.5, low=0.0, high=1.0, doc="frames of which less arrived are left out; lost chirps of others are marked")


def check_settings(config: Dca1000Config, ti: TiConfig, size: int) -> None:
    """Refuse (`ConfigError`) what could only give silence or nonsense: settings that contradict the .cfg, or frames of ``size`` bytes."""
    four = ti.platform.lower().startswith(("xwr14", "xwr12"))
    if ti.platform and four != (config.lanes == 4):
        raise ConfigError(f"{config.config} is for {ti.platform}, which has {4 if four else 2} lanes, but dca1000.lanes is {config.lanes}")
    packets = -(-size // LARGEST)
    if packets * config.packet_delay > ti.frame_interval:
        raise ConfigError(
            f"dca1000.packet_delay: {packets} packets a frame, {config.packet_delay * 1e6:g} us apart, take longer than a frame "
            f"({ti.frame_interval * 1e3:g} ms); lower it"
        )
    if not config.serial_port:
        return
    if not ti.streams:
        raise ConfigError(f"{config.config}: the sensor would not send its raw samples; add the line: lvdsStreamCfg -1 0 1 0")
    if ti.n_frame:
        raise ConfigError(f"{config.config}: frameCfg ends after {ti.n_frame} frames; make its fourth number 0, so that it goes on")
    if config.lanes == 2 and ti.order not in ("", config.order):
        raise ConfigError(f"{config.config}: adcbufCfg gives samples in the order {ti.order}, but dca1000.order is {config.order}")
