"""Effects beyond ideal echoes; `radar_sim.effects.config` names them, `radar_sim.effects.chain` puts them in order."""
