"""The catalogue: every kind of effect that can be asked for by name, tried by a diagnosis, planted in a record.

Each entry brings its physics and bench check (`Effect.info`), its search range (`Effect.candidates`) and, under the
same name in ``make_record(effects={kind: strength})``, its planted truth.
"""

from __future__ import annotations

from .covariates import Covariate, Interaction, LaggedCovariate
from .hinge import Hinge
from .hysteresis import Hysteresis
from .periodic import Periodic
from .products import LagProducts
from .protocol import Effect
from .rates import Delay, Rate
from .thermal import StaticPolynomial, ThermalLag
from .time import Drift, LogAgeing, SensitivityDrift, Step
from .transient import InitialTransient

CATALOGUE: dict[str, type[Effect]] = {
    effect.kind: effect
    for effect in (
        StaticPolynomial,
        ThermalLag,
        InitialTransient,
        LagProducts,
        Rate,
        Delay,
        Covariate,
        LaggedCovariate,
        Interaction,
        Drift,
        LogAgeing,
        SensitivityDrift,
        Step,
        Hysteresis,
        Hinge,
        Periodic,
    )
}
"""Kind -> class: thermal kinds first, then recorded columns, then time, then what depends on history or place."""
