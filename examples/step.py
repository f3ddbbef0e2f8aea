"""Step a simulation by hand, and a flight as a gymnasium environment."""

import gymnasium as gym

import swarm_mj as sm

sim = sm.simulation(sm.load("eros-quick"))
while sim.time < 120.0:
    sim.step()
    if sim.time % 30.0 == 0.0:
        print(f"{sim.time:5.0f} s: fastest wheel {abs(sim.data.qvel).max():6.1f} rad/s, contacts {sim.data.ncon}")

env = gym.make("swarm_mj.envs:SwarmObserve-v0", missions=["ellipsoid-train-1"])
observation, info = env.reset(seed=0)
for _ in range(10):
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
print(f"after {info['time_s']:.0f} s: {info['coverage_percent']:.1f} % of the yardstick seen, reward {reward:.3f}")
env.close()
