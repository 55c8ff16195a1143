"""Least squares from cross products in bands: what the rows themselves say."""

import numpy as np
import pytest

from thermocorr.judgement.bandwise import BaseProducts, ExplanationColumns

N, BANDS = 60, 5
BAND = np.repeat(np.arange(BANDS), N // BANDS)


def in_bands(one, other):
    """Cross products of columns in each band."""
    return np.stack([one[band == BAND].T @ other[band == BAND] for band in range(BANDS)])


@pytest.fixture
def rows():
    """Reading, base, columns of four explanations (the last lies in the base), and three sets of weights."""
    rng = np.random.default_rng(4)
    z, Q = rng.standard_normal((N, 1)), rng.standard_normal((N, 3))
    beside = [rng.standard_normal((N, width)) for width in (1, 2, 1)]
    return z, Q, [*beside, Q @ [[1.0], [2.0], [0.0]]], rng.uniform(0.5, 2.0, (3, BANDS))


def products(z, Q, beside):
    base = BaseProducts(zz=in_bands(z, z)[:, 0, 0], Qz=in_bands(Q, z)[:, :, 0], QQ=in_bands(Q, Q))
    return base, [
        ExplanationColumns(rows=x, own=in_bands(x, x), base=in_bands(Q, x), reading=in_bands(x, z)[:, :, 0])
        for x in beside
    ]


def fitted(z, columns, weights):
    """Coefficients under weights of the bands, and what they leave."""
    root = np.sqrt(weights[BAND])[:, None]
    coef = np.linalg.lstsq(root * columns, root * z, rcond=None)[0]
    return coef[:, 0], z - columns @ coef


def test_each_explanation_is_fitted_under_its_own_weights(rows):
    z, Q, beside, W = rows
    base, founds = products(z, Q, beside)
    coefs, power = base.solved(W, [founds[1], None, founds[0]])
    for j, columns in enumerate((np.hstack((Q, beside[1])), Q, np.hstack((Q, beside[0])))):
        coef, left = fitted(z, columns, W[j])
        np.testing.assert_allclose(coefs[j], coef, rtol=1e-9)
        np.testing.assert_allclose(power[:, j], in_bands(left, left)[:, 0, 0], rtol=1e-9)


def test_what_each_explanation_takes_away(rows):
    z, Q, beside, W = rows
    base, founds = products(z, Q, beside)
    taken, left = base.taken(W, founds)
    for j, weights in enumerate(W):
        remains = [float(weights[BAND] @ fitted(z, np.hstack((Q, x)), weights)[1][:, 0] ** 2) for x in beside]
        alone = float(weights[BAND] @ fitted(z, Q, weights)[1][:, 0] ** 2)
        assert left[j] == pytest.approx(alone, rel=1e-9)
        np.testing.assert_allclose(taken[j, :3], alone - np.array(remains[:3]), rtol=1e-8)
        assert taken[j, 3] == 0.0


def test_wide_explanations_alone(rows):
    z, Q, beside, W = rows
    base, founds = products(z, Q, beside)
    np.testing.assert_allclose(base.taken(W, founds[1:2])[0][:, 0], base.taken(W, founds)[0][:, 1], rtol=1e-12)
