"""Flies small.toml in random directions over twenty fields, and prints the loss rates, with Gymnasium's interface only.

    python python/examples/random_policy.py
"""

from pathlib import Path

import gymnasium
import numpy as np
import skysink

scenario = skysink.Scenario.load(Path(__file__).with_name("small.toml"))
env = gymnasium.make("skysink/DataCollection-v0", scenario=scenario)
env.action_space.seed(1)

loss_rates = []
for episode in range(20):
    seen, info = env.reset()  # the field of the scenario's seed first, then of the next one
    lost = []
    truncated = False
    while not truncated:
        seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
        lost.append(-float(reward))
    loss_rates.append(np.mean(lost))  # every slot samples the same number of bits
print(f"loss rate {np.mean(loss_rates):.4f}, from {min(loss_rates):.4f} to {max(loss_rates):.4f}")
