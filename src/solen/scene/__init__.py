"""Scenes: regions, interfaces, sources and detectors, built by hand, from a sensor or from JSON."""

from solen.scene.json import dumps, load, loads, save
from solen.scene.model import Interface, Monitor, Region, Scene
from solen.scene.sensor import sensor_scene
from solen.scene.sources import Beam, Chip, Fan, Launch, Rays, Source

__all__ = [
    "Beam",
    "Chip",
    "Fan",
    "Interface",
    "Launch",
    "Monitor",
    "Rays",
    "Region",
    "Scene",
    "Source",
    "dumps",
    "load",
    "loads",
    "save",
    "sensor_scene",
]
