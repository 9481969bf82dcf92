"""Exposure: the band of illuminance of a sensor, against its equations and counted photons."""

import dataclasses

import numpy as np
import pytest

import rastercov as rc
from rastercov.base.arguments import rules_of
from rastercov.base.errors import ConfigError
from rastercov.core.camera.exposure import luminous_efficiency

SENSOR = {
    "exposure_time": 0.01, "f_number": 4.0, "pixel_size": 3.45e-6, "quantum_efficiency": 0.65,
    "full_well": 10_500, "dark_noise": 2.5, "gain": 0.35, "reflectance": 0.4,
}  # fmt: skip


def electrons(exposure, irradiance):
    """Mean electrons of a pixel under an irradiance, W/m^2."""
    on_sensor = exposure.reflectance * irradiance * exposure.transmission
    on_sensor /= 4 * exposure.f_number**2 * (1 + exposure.magnification) ** 2
    energy = on_sensor * exposure.pixel_size**2 * exposure.exposure_time
    return exposure.quantum_efficiency * energy / (6.62607015e-34 * 299792458 / exposure.wavelength)


def test_at_the_ends_of_the_band_are_the_snr_and_the_saturation_asked_for():
    exposure = rc.Exposure(**SENSOR, min_snr=40, max_saturation=0.9, magnification=0.1)
    least, most = exposure.band("W/m2")
    n = electrons(exposure, least)
    rng = np.random.default_rng(5)
    counted = rng.poisson(n, 400_000) + rng.normal(0, 2.5, 400_000)
    read = np.rint(counted * 0.35) / 0.35
    assert n / read.std() == pytest.approx(40, rel=0.01)
    assert electrons(exposure, most) == pytest.approx(0.9 * 10_500)


def test_lx_are_watts_by_the_sensitivity_of_the_eye():
    green = rc.Exposure(**SENSOR, min_snr=20)
    assert green.band()[0] / green.band("W/m2")[0] == pytest.approx(683, rel=1e-12)
    infrared = rc.Exposure(**SENSOR, wavelength=850e-9)
    assert infrared.band("W/m2")[0] == 0
    with pytest.raises(ConfigError, match="expected W/m2 at 850 nm, got lx, undefined"):
        infrared.band()
    with pytest.raises(ConfigError, match="unit to be lx or W/m2"):
        green.band("fc")


# V of the CIE 1924 curve, as the tables of 1 nm print it; odd ones lie between our values.
V_OF_NM = {
    380: 3.9e-5, 381: 4.28264e-5, 385: 6.4e-5, 390: 0.00012, 398: 0.00031852, 399: 0.0003572667,
    400: 0.000396, 403: 0.000517876, 405: 0.00064, 407: 0.0008255, 413: 0.001720368, 420: 0.004,
    425: 0.0073, 429: 0.01066443, 438: 0.02045392, 441: 0.02429461,
    450: 0.038, 456: 0.05024368, 461: 0.06260197, 470: 0.09098, 473: 0.1033674, 488: 0.1912735,
    490: 0.20802, 498: 0.2950505, 507: 0.4443096, 532: 0.8849624, 540: 0.954, 555: 1.0,
    561: 0.9926005, 577: 0.8982772, 589: 0.7691547, 600: 0.631, 612: 0.4780304, 630: 0.265,
    633: 0.2353344, 650: 0.107, 660: 0.061, 683: 0.0138107, 700: 0.004102, 720: 0.001047,
    752: 0.0001043224, 768: 3.444868e-5, 778: 1.721687e-5, 780: 1.499e-5,
}  # fmt: skip


@pytest.mark.parametrize("nm", V_OF_NM)
def test_lumens_are_of_the_photopic_curve_of_1924(nm):
    exposure = rc.Exposure(**SENSOR, min_snr=20, wavelength=nm * 1e-9)
    values = exposure.band()[1] / exposure.band("W/m2")[1]
    assert values == pytest.approx(683 * V_OF_NM[nm], rel=0.003)


def test_sensitivity_rises_to_its_peak_and_falls_from_there():
    nm = np.linspace(380, 780, 4001)
    value = np.array([luminous_efficiency(each * 1e-9) for each in nm])
    assert (np.diff(value)[nm[1:] <= 555] > 0).all()
    assert (np.diff(value)[nm[:-1] >= 555.1] < 0).all()
    assert value.max() == pytest.approx(1, abs=1e-5)


def test_a_task_within_the_band_says_so():
    exposure = rc.Exposure(**SENSOR, min_snr=40, max_saturation=0.9)
    least, most = exposure.band()
    task = rc.Task(min_illuminance=1).exposed(exposure)
    assert (task.min_illuminance, task.max_illuminance) == (least, most)
    tight = rc.Task(min_illuminance=least * 2, max_illuminance=most / 2)
    assert tight.exposed(exposure) == tight
    assert exposure.in_words().startswith("exposure: SNR 40 or more and saturation 0.9 or less is ")
    with pytest.raises(ConfigError, match="max_illuminance above min_illuminance"):
        rc.Task(min_illuminance=most * 2).exposed(exposure)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"min_snr": 200}, "expected min_snr to be reached below saturation, 10,500"),
        ({"exposure_time": 0}, "exposure_time to be from 1e-12 to 1e+09, got 0"),
        ({"quantum_efficiency": 65}, "quantum_efficiency to be"),
    ],
)
def test_wrong_exposures_are_refused_in_one_line(values, words):
    with pytest.raises(ConfigError) as caught:
        rc.Exposure(**SENSOR | values)
    assert words in str(caught.value)


def test_defaults_are_plain_values_within_the_limits():
    """So that they need no check."""
    rules = [rule for rule in rules_of(rc.Exposure) if rule.default is not dataclasses.MISSING]
    for rule in rules:
        checked = rule.check(rule.default)
        assert checked == rule.default
        assert type(checked) is type(rule.default)
    assert rules
