"""Exposure: the illuminances with which a camera has enough signal, and is not saturated.

A Lambertian surface of reflectance rho under an illuminance E gives the sensor

    E_s = rho E tau / (4 N^2 (1 + m)^2),   photons p = E_s A t lambda / (h c),
    electrons n = eta p,   SNR = n / sqrt(sigma_d^2 + sigma_q^2 / K^2 + n),

whatever its distance, with f-number N, magnification m, transmission tau of the lens, area A of a
pixel, time t, quantum efficiency eta, dark noise sigma_d, quantisation sigma_q = 1 / sqrt(12) and
gain K. So a minimum SNR and a maximum saturation limit E to a band.

EMVA 1288. Standard for Characterization of Image Sensors and Cameras. Release 4.0, 2021. CIE
018:2019. The Basis of Physical Photometry; its curve of 1924 as ISO/CIE 23539:2023 has it.

Illuminances and gloss as text: of files, plans and commands.
"""

import math
import re
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le
from typing_extensions import Doc

from rastercov.base import CameraError, ConfigError, check_choice, check_limits, matmul, shown
from rastercov.base.arguments import Quantity, Reads
from rastercov.base.format import number


def illuminance(text: str) -> Quantity:
    """Illuminance of text such as "300", "300 lx" or "5 W/m2"; ValueError for other text."""
    result = _ILLUMINANCE.fullmatch(text.strip())
    if not result:
        raise ValueError(f"a number, lx or W/m2, such as 300 lx, got {shown(text)}")
    return Quantity(float(result[1]), (result[2] or "").replace("²", "2"))


_ILLUMINANCE = re.compile(r"([-+]?[0-9]+(?:\.[0-9]*)?(?:e[-+]?[0-9]+)?)\s*(lx|W/m2|W/m²)?")
LIGHT = Reads(illuminance, (), _ILLUMINANCE.pattern, "LX")
"""Metadata of a field that is an illuminance, in the unit of the lamps."""


def check_unit(name: str, value: float, unit: str) -> None:
    """CameraError for an illuminance that was given in another unit than that of the lamps."""
    given = getattr(value, "unit", "")
    if given not in ("", unit):
        raise CameraError(
            f"expected {name} in {unit}, the unit of the lamps, got {given}; lx and W/m2 cannot be "
            "converted"
        )


GLOSSES = {"matt": 0.0, "satin": 12.0, "polished": 30.0}
"""Degrees off the mirror direction in which a surface shows a lamp, by its gloss."""


def gloss(text: str) -> float:
    """Angle of a name of `GLOSSES`, or of text that is a number, degrees; else ValueError."""
    try:
        return GLOSSES[text.strip()] if text.strip() in GLOSSES else float(text)
    except ValueError:
        raise ValueError(f"degrees, or one of {', '.join(GLOSSES)}, got {shown(text)}") from None


GLOSS = Reads(gloss, tuple(GLOSSES), r"[0-9.]+", "DEG|NAME")
"""Metadata of a field that is the angle of a highlight."""


PLANCK, LIGHT_SPEED = 6.62607015e-34, 299792458.0
LUMENS_PER_WATT = 683.0
"""Of light at the peak of the eye's sensitivity, 555 nm."""
VISIBLE = 380e-9, 780e-9
"""Metres: wavelengths of which there are lumens."""

# 1e5 V, every 2 nm from 380 to 428 nm, and every 5 nm from 430 to 780 nm.
_TABLE = """
3.9 4.6915 5.7176 7.2344 9.3508 12 15.149 19.182 24.691 31.852 39.6 47.302 57.222 72.456
94.116 121 153.08 193.53 245.48 311.78 400 515.93 654.62 808.65 976.77 1160 1684 2300 2980
3800 4800 6000 7390 9098 11260 13902 16930 20802 25860 32300 40730 50300 60820 71000 79320
86200 91485 95400 98030 99495 100000 99500 97860 95200 91540 87000 81630 75700 69490 63100
56680 50300 44120 38100 32100 26500 21700 17500 13820 10700 8160 6100 4458 3200 2320 1700
1192 821 572.3 410.2 292.9 209.1 148.4 104.7 74 52 36.11 24.92 17.19 12 8.48 6 4.24 3 2.12
1.499
"""


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Sensor, lens and exposure time of a camera, and the surface it images.

    A Lambertian surface under an irradiance E gives a pixel n electrons, whatever its distance:

        n = eta A t lambda / (h c) rho E tau / (4 N^2 (1 + m)^2),
        SNR = n / sqrt(sigma_d^2 + 1 / (12 K^2) + n).

    The minimum SNR and the maximum saturation limit E to a `band`. Light has one wavelength.
    Conversion to lx is by the luminous efficiency V of the CIE 1924 photopic curve, within 0.3 %.

    Parameters
    ----------
    exposure_time : float
        Exposure time t, seconds.
    f_number : float
        F-number N.
    pixel_size : float
        Side of a square pixel, metres; its square is A.
    quantum_efficiency : float
        Quantum efficiency eta, electrons per photon, (0, 1].
    full_well : float
        Electrons at which a pixel is saturated.
    dark_noise : float
        Temporal dark noise sigma_d, electrons; 0 unless given.
    gain : float, optional
        System gain K, digital numbers per electron; no quantisation noise unless given.
    reflectance, transmission : float
        Reflectance rho of the surface and transmission tau of the lens, (0, 1]; 0.5 and 1 unless
        given.
    wavelength : float
        Wavelength lambda, metres; 555 nm unless given.
    magnification : float
        m, size of the image over that of the object; 0, the default, for distant objects.
    min_snr : float
        Minimum SNR; 0, the default, for none.
    max_saturation : float
        Maximum share of `full_well`, (0, 1]; 1 unless given.

    Raises
    ------
    ConfigError
        For a value outside its limits, and for a band that is empty.

    Examples
    --------
    >>> import rastercov as rc
    >>> sensor = rc.Exposure(
    ...     exposure_time=0.01, f_number=4, pixel_size=3e-6, quantum_efficiency=0.6,
    ...     full_well=10_000, dark_noise=5, min_snr=10, max_saturation=0.9,
    ... )
    >>> low, high = sensor.band()  # lx: neither dark nor saturated
    >>> round(low), round(high)
    (70, 5215)
    """

    exposure_time: Annotated[float, Ge(1e-12), Le(1e9), Doc("Time, seconds.")]
    f_number: Annotated[float, Ge(1e-3), Le(1e6), Doc("f-number.")]
    pixel_size: Annotated[float, Ge(1e-9), Le(1), Doc("Side of a pixel, metres.")]
    quantum_efficiency: Annotated[float, Ge(1e-9), Le(1), Doc("Electrons per photon.")]
    full_well: Annotated[float, Gt(0), Le(1e12), Doc("Electrons at saturation.")]
    dark_noise: Annotated[float, Ge(0), Le(1e12), Doc("Noise in the dark, electrons.")] = 0.0
    gain: (
        Annotated[float, Ge(1e-9), Le(1e9), Doc("Digital numbers per electron, for quantisation.")]
        | None
    ) = None
    reflectance: Annotated[float, Ge(1e-9), Le(1), Doc("Reflectance of the surface.")] = 0.5
    transmission: Annotated[float, Ge(1e-9), Le(1), Doc("Transmission of the lens.")] = 1.0
    wavelength: Annotated[float, Ge(1e-9), Le(1e-3), Doc("Wavelength of the light, metres.")] = (
        555e-9
    )
    magnification: Annotated[float, Ge(0), Le(1e6), Doc("Image size over object size.")] = 0.0
    min_snr: Annotated[float, Ge(0), Le(1e9), Doc("Least signal-to-noise ratio.")] = 0.0
    max_saturation: Annotated[float, Gt(0), Le(1), Doc("Greatest share of the full well.")] = 1.0

    def __post_init__(self) -> None:
        check_limits(self)
        least, most = self.electrons()
        if not least < most:
            raise ConfigError(
                f"expected min_snr to be reached below saturation, {number(most)} electrons, got "
                f"{number(least)}; lower it, or use a sensor with more full_well"
            )

    def electrons(self) -> tuple[float, float]:
        """Minimum and maximum number of electrons of a pixel.

        The minimum is n = S^2 (1 + sqrt(1 + 4 s^2 / S^2)) / 2, with S the SNR and s the noise in
        the dark, quantisation included.
        """
        quantised = 0.0 if self.gain is None else 1 / (12 * self.gain**2)
        dark, snr = self.dark_noise**2 + quantised, self.min_snr
        least = snr * (snr + math.sqrt(snr**2 + 4 * dark)) / 2
        return least, self.max_saturation * self.full_well

    def band(self, unit: str = "lx") -> tuple[float, float]:
        """Minimum and maximum illuminance in lx, or irradiance in W/m^2 for `unit` "W/m2".

        ConfigError for lx at an invisible wavelength, and for another unit.

        Examples
        --------
        >>> import rastercov as rc
        >>> sensor = rc.Exposure(
        ...     exposure_time=0.01, f_number=4, pixel_size=3e-6, quantum_efficiency=0.6,
        ...     full_well=10_000,
        ... )
        >>> [float(f"{limit:.3g}") for limit in sensor.band("lx")]
        [0.0, 5790.0]
        """
        check_choice("unit", unit, ("lx", "W/m2"))
        photon = PLANCK * LIGHT_SPEED / self.wavelength
        per_electron = photon * 4 * self.f_number**2 * (1 + self.magnification) ** 2
        per_electron /= self.quantum_efficiency * self.reflectance * self.transmission
        per_electron /= self.pixel_size**2 * self.exposure_time
        if unit == "lx":
            if not VISIBLE[0] <= self.wavelength <= VISIBLE[1]:
                raise ConfigError(
                    f"expected W/m2 at {self.wavelength * 1e9:.0f} nm, got lx, undefined there; "
                    "give lamps in W/sr"
                )
            per_electron *= LUMENS_PER_WATT * luminous_efficiency(self.wavelength)
        least, most = self.electrons()
        return least * per_electron, most * per_electron

    def in_words(self, unit: str = "lx") -> str:
        """The illuminance band as a line of text."""
        least, most = self.band(unit)
        asked = [f"SNR {number(self.min_snr)} or more"] if self.min_snr else []
        asked.append(f"saturation {number(self.max_saturation)} or less")
        return f"exposure: {' and '.join(asked)} is {number(least)} to {number(most)} {unit}"


def luminous_efficiency(wavelength: float) -> float:
    """V at a wavelength of `VISIBLE`, metres, within 0.3 % of the tables of every nm.

    Cubics of ln V through four neighbours in the table.
    """
    table = np.array(_TABLE.split(), np.float64)
    nm, nodes = wavelength * 1e9, np.r_[380.0:430:2, 430.0:781:5]
    first = int(np.clip(np.searchsorted(nodes, nm) - 2, 0, len(nodes) - 4))
    near, logarithm = nodes[first : first + 4], np.log(table[first : first + 4])
    others = [np.delete(near, row) for row in range(4)]
    basis = [np.prod((nm - x) / (at - x)) for at, x in zip(near, others, strict=True)]
    return float(1e-5 * np.exp(matmul(basis, logarithm)))
