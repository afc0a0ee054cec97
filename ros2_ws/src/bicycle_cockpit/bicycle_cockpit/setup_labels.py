"""Labels for people of what the form of a ride offers; ids are in its tooltips."""

from __future__ import annotations

from bicycle_sim.task.scenario import Scenario

BICYCLES = {
    "balance-assist": "Gazelle with steer motor, no rider",
    "balance-assist-rider": "Gazelle with steer motor and rider",
    "benchmark": "Benchmark bicycle of 2007, with rider",
    "browser": "Batavus Browser, no rider",
    "browser-instrumented": "Batavus Browser, instrumented, no rider",
    "browser-leaning-rider": "Batavus Browser, rider leans",
    "browser-rider": "Batavus Browser, with rider",
    "crescendo": "Batavus Crescendo, no rider",
    "fisher": "Gary Fisher mountain bicycle, no rider",
    "pista": "Bianchi Pista, no rider",
    "pista-rider": "Bianchi Pista, with rider",
    "rigid": "Davis instrumented bicycle, no rider",
    "rigid-rider": "Davis instrumented bicycle, with rider",
    "silver": "Kooijman's instrumented bicycle, no rider",
    "steer-by-wire": "Delft e-bike steered by wire, no rider",
    "two-mass-skate": "Two-mass-skate bicycle of 2011",
    "yellow": "Yellow bicycle, no rider",
    "yellow-reversed": "Yellow bicycle, fork reversed, no rider",
}
SENSORS = {
    "mpu6050": "IMU and encoders, cheap ones",
    "mpu6050-gnss": "The same and a satellite receiver",
    "mpu6050-rtk": "The same and an RTK receiver",
    "perfect": "Perfect sensors",
    "rough": "Poor sensors, badly mounted",
}
PLANTS = {
    "choi": "The paper's bicycle",
    "whipple": "Measured bicycle, Whipple-Carvallo model",
    "mujoco": "Measured bicycle, in MuJoCo",
}


def in_words(name: str) -> str:
    """Return an id as words: "circle-10" is "Circle 10"."""
    return name.replace("-", " ").capitalize()


def of_scenario(one: Scenario) -> str:
    """Return a scenario in words: its tasks, its speed and what may be moved."""
    words = in_words(one.name).replace("start random", "start, random")
    words = words.replace("start fixed", "start, fixed").replace(" fixed speed", "")
    name = words.replace(" small displacement", " goals")
    body = f", body ±{100 * one.displacement_limit:g} cm" if one.displacement_limit else ""
    pedals = ", pedals" if one.pedal_limit else ""
    return f"{name}, {one.start_speed:.2g} m/s{body}{pedals}"
