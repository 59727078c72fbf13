"""The default array keeps the promises of the design page."""

import math

import numpy as np
import pytest

from radar_core import AntennaArray, ConfigError, Waveform

WAVELENGTH = Waveform().wavelength


def crb(array: AntennaArray, snr_db: float) -> tuple[float, float]:
    """Joint Cramér-Rao bound of azimuth and elevation at boresight, one snapshot of unknown complex amplitude, in degrees."""
    eps = 1e-6
    a = array.steering(0.0, 0.0, WAVELENGTH)
    d = np.stack([(array.steering(eps, 0, WAVELENGTH) - a) / eps, (array.steering(0, eps, WAVELENGTH) - a) / eps], axis=1)
    projected = d - np.outer(a, a.conj() @ d) / (a.conj() @ a)
    fisher = 2 * 10 ** (snr_db / 10) * (projected.conj().T @ projected).real
    return tuple(np.degrees(np.sqrt(np.diag(np.linalg.inv(fisher)))))


def test_virtual_array_order_and_extent():
    """Channel v = tx * n_rx + rx; eight elements, 3.5 wavelengths wide, two rows half a wavelength apart."""
    virtual = AntennaArray().virtual / WAVELENGTH
    assert virtual.shape == (8, 2)
    np.testing.assert_allclose(virtual[5], [2.5, 0.5], atol=1e-12)
    assert np.ptp(virtual[:, 0]) == pytest.approx(3.5)
    assert np.ptp(virtual[:, 1]) == pytest.approx(0.5)


def test_design_page_bounds():
    """0.20 and 0.91 degrees with both transmitters, 0.58 and 1.29 with one, at 20 dB per channel (design page, two digits)."""
    assert crb(AntennaArray(), 20.0) == pytest.approx((0.20, 0.91), abs=0.01)
    assert crb(AntennaArray(tx=((0.0, 0.0),)), 20.0) == pytest.approx((0.58, 1.29), abs=0.01)


def test_no_ambiguity_in_the_field_of_view():
    """Ambiguity function (3.2) outside the main lobe stays at or below 0.73 over +-60 x +-30 degrees (3 degree grid)."""
    az, el = np.meshgrid(np.radians(np.arange(-60, 61, 3.0)), np.radians(np.arange(-30, 31, 3.0)), indexing="ij")
    a = AntennaArray().steering(az.ravel(), el.ravel(), WAVELENGTH)
    chi = np.abs(a.conj() @ a.T) / 8
    u = np.stack([np.cos(el) * np.sin(az), np.sin(el)], -1).reshape(-1, 2)
    # The main lobe ends at its first minima: 2/7 in y (3.5 wavelengths) and 1 in z (two rows half a wavelength apart).
    apart = (np.abs(u[:, None, 0] - u[None, :, 0]) > 2 / 7) | (np.abs(u[:, None, 1] - u[None, :, 1]) > 0.9)
    assert chi[apart].max() <= 0.735


def test_steering_sign_and_symmetry():
    """A target on the left (positive azimuth) reaches elements on the left earlier: their phase lags less, exp(-j 2 pi p.u / lambda)."""
    array = AntennaArray()
    a = array.steering(math.radians(10), 0.0, WAVELENGTH)
    expected = -2 * math.pi * array.virtual[:, 0] * math.sin(math.radians(10)) / WAVELENGTH
    np.testing.assert_allclose(np.angle(a * np.exp(-1j * expected)), 0, atol=1e-12)
    np.testing.assert_allclose(array.steering([-0.3, 0.3], [-0.1, 0.1], WAVELENGTH)[0].conj(), array.steering(0.3, 0.1, WAVELENGTH))


def test_empty_array_is_refused():
    """An array without elements cannot be anything but a mistake."""
    with pytest.raises(ConfigError, match="at least one transmitter"):
        AntennaArray(rx=())
