"""Scenes: regions, interfaces, sources and detectors, built by hand, from a sensor or from JSON."""

from solen.scene.json import dumps, load, loads, save
from solen.scene.model import Extrusion, Interface, Monitor, Region, Scene
from solen.scene.sensor import sensor_scene
from solen.scene.sources import Beam, Chip, Fan, Launch, Rays, Source
from solen.scene.surface import Coating, Gaussian, HarveyShack, Lambertian, Layer, Scatter, Surface, Texture

__all__ = [
    "Beam",
    "Chip",
    "Coating",
    "Extrusion",
    "Fan",
    "Gaussian",
    "HarveyShack",
    "Interface",
    "Lambertian",
    "Launch",
    "Layer",
    "Monitor",
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
