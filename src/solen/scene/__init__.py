"""Scenes: regions, interfaces, sources and detectors, built by hand, from a sensor or from JSON."""

from solen.scene.json import dumps, load, loads, save
from solen.scene.model import Extrusion, Interface, Monitor, Region, Scene
from solen.scene.sensor import sensor_scene
from solen.scene.sources import (
    Ambient,
    Beam,
    Chip,
    CosinePower,
    Emitter,
    Fan,
    Isotropic,
    Launch,
    PatternTable,
    RayFile,
    Rays,
    Source,
)
from solen.scene.surface import Coating, Gaussian, HarveyShack, Lambertian, Layer, Scatter, Surface, Texture

__all__ = [
    "Ambient",
    "Beam",
    "Chip",
    "Coating",
    "CosinePower",
    "Emitter",
    "Extrusion",
    "Fan",
    "Gaussian",
    "HarveyShack",
    "Interface",
    "Isotropic",
    "Lambertian",
    "Launch",
    "Layer",
    "Monitor",
    "PatternTable",
    "RayFile",
    "Rays",
    "Region",
    "Scatter",
    "Scene",
    "Source",
    "Surface",
    "Texture",
    "dumps",
    "load",
    "loads",
    "save",
    "sensor_scene",
]
