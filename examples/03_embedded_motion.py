# /// script
# dependencies = ["comwalk"]
# ///
"""Dance on both feet: once with legs that know of the arms, once without."""

import numpy as np

from comwalk.config import DanceConfig
from comwalk.control import BodySettings
from comwalk.setup import build_dance

for embed in (True, False):
    body = BodySettings(embed_motion=embed)
    run = build_dance(DanceConfig(motion="paper", duration=6.0, body=body)).run()
    away = run.log["zmp"] - run.log["zmp_ref"]  # [m]
    legs = "know of" if embed else "ignore"
    print(f"legs {legs} the arms: ZMP within {1e3 * np.abs(away).max():.1f} mm")
