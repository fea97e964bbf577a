"""Flies small.toml straight to the fullest sensor node over twenty fields, and prints the loss rates.

    python python/examples/greedy_policy.py
"""

from pathlib import Path

import gymnasium
import numpy as np
import skysink

SIDE_PER_REACH = 100.0 / 20.0  # area.side_m / (uav.max_speed_mps * slot_s)

scenario = skysink.Scenario.load(Path(__file__).with_name("small.toml"))
keys = ("uav", "queues", "slot", "positions")
env = gymnasium.make("skysink/DataCollection-v0", scenario=scenario, observation=keys)

loss_rates = []
for episode in range(20):
    seen, info = env.reset()  # the field of the scenario's seed first, then of the next one
    lost = []
    truncated = False
    while not truncated:
        towards = (seen["positions"][np.argmax(seen["queues"])] - seen["uav"][:2]) * SIDE_PER_REACH
        action = towards / max(1.0, np.linalg.norm(towards))
        seen, reward, terminated, truncated, info = env.step(action.astype(np.float32))
        lost.append(-float(reward))
    loss_rates.append(np.mean(lost))  # every slot samples the same number of bits
print(f"loss rate {np.mean(loss_rates):.4f}, from {min(loss_rates):.4f} to {max(loss_rates):.4f}")
