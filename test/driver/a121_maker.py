"""Run by a Python that has the maker's acconeer-exptool: its client measures at a port, records to a file, and prints what it saw."""

import json
import sys

from acconeer.exptool import a121

port, path, n_frame, knobs = int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), json.loads(sys.argv[4])
given = {"profile": a121.Profile.PROFILE_3, "prf": a121.PRF.PRF_15_6_MHz, "inter_frame_idle_state": a121.IdleState.READY}
client = a121.Client.open(ip_address="127.0.0.1", tcp_port=port)
client.setup_session(a121.SensorConfig(**knobs, **given))
with a121.H5Recorder(path, client):
    client.start_session()
    frames = [client.get_next() for _ in range(n_frame)]
    client.stop_session()
told = {"version": client.server_info.rss_version, "ticks": [one.tick for one in frames], "temperature": frames[0].temperature}
print(json.dumps({**told, "frames": [[one.frame.real.tolist(), one.frame.imag.tolist()] for one in frames]}))
client.close()
