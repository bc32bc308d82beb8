"""Kennedy and Carpenter's additive pairs of order 4(3) and 5(4), implicit in bending."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from flexarm.integrate.additive import SOFTENED, advance_additive
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.integrate.steps import IMPACTS, STEP, TIME
from flexarm.kernels.implicit_step import constants_to_soften
from flexarm.kernels.layout import ArmConstants


class AdditiveTableau(NamedTuple):
    """Coefficients of s stages; rows of the explicit part for the new point too.

    Attributes:
        explicit, implicit: (s + 1, s) rows of the stages and of the new point, which they share.
        c: (s + 1,) abscissae. error: (s + 1,) weights of the error estimate.
    """

    order: int
    explicit: FloatArray
    implicit: FloatArray
    c: FloatArray
    error: FloatArray


def _tableau(
    order: int, explicit: FloatArray, implicit: FloatArray, embedded: FloatArray
) -> AdditiveTableau:
    b = implicit[-1]
    return AdditiveTableau(
        order=order,
        explicit=np.vstack([explicit, b]),
        implicit=np.vstack([implicit, b]),
        c=np.append(explicit.sum(axis=1), 1.0),
        error=np.append(b - embedded, 0.0),
    )


def _lower(rows: list[list[float]]) -> FloatArray:
    """Fill up the rows of a square matrix with zeros."""
    square = np.zeros((len(rows), len(rows)))
    for k, row in enumerate(rows):
        square[k, : len(row)] = row
    return square


def _order_4() -> AdditiveTableau:
    """ARK4(3)6L[2]SA, appendix C of the paper."""
    explicit = [
        [],
        [1 / 2],
        [13861 / 62500, 6889 / 62500],
        [
            -116923316275 / 2393684061468,
            -2731218467317 / 15368042101831,
            9408046702089 / 11113171139209,
        ],
        [
            -451086348788 / 2902428689909,
            -2682348792572 / 7519795681897,
            12662868775082 / 11960479115383,
            3355817975965 / 11060851509271,
        ],
        [
            647845179188 / 3216320057751,
            73281519250 / 8382639484533,
            552539513391 / 3454668386233,
            3354512671639 / 8306763924573,
            4040 / 17871,
        ],
    ]
    implicit = [
        [],
        [1 / 4, 1 / 4],
        [8611 / 62500, -1743 / 31250, 1 / 4],
        [5012029 / 34652500, -654441 / 2922500, 174375 / 388108, 1 / 4],
        [
            15267082809 / 155376265600,
            -71443401 / 120774400,
            730878875 / 902184768,
            2285395 / 8070912,
            1 / 4,
        ],
        [82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211, 1 / 4],
    ]
    embedded = [
        4586570599 / 29645900160,
        0.0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ]
    return _tableau(4, _lower(explicit), _lower(implicit), np.array(embedded))


def _order_5() -> AdditiveTableau:
    """ARK5(4)8L[2]SA, appendix D of the paper."""
    explicit = [
        [],
        [41 / 100],
        [367902744464 / 2072280473677, 677623207551 / 8224143866563],
        [1268023523408 / 10340822734521, 0.0, 1029933939417 / 13636558850479],
        [
            14463281900351 / 6315353703477,
            0.0,
            66114435211212 / 5879490589093,
            -54053170152839 / 4284798021562,
        ],
        [
            14090043504691 / 34967701212078,
            0.0,
            15191511035443 / 11219624916014,
            -18461159152457 / 12425892160975,
            -281667163811 / 9011619295870,
        ],
        [
            19230459214898 / 13134317526959,
            0.0,
            21275331358303 / 2942455364971,
            -38145345988419 / 4862620318723,
            -1 / 8,
            -1 / 8,
        ],
        [
            -19977161125411 / 11928030595625,
            0.0,
            -40795976796054 / 6384907823539,
            177454434618887 / 12078138498510,
            782672205425 / 8267701900261,
            -69563011059811 / 9646580694205,
            7356628210526 / 4942186776405,
        ],
    ]
    implicit = [
        [],
        [41 / 200, 41 / 200],
        [41 / 400, -567603406766 / 11931857230679, 41 / 200],
        [683785636431 / 9252920307686, 0.0, -110385047103 / 1367015193373, 41 / 200],
        [
            3016520224154 / 10081342136671,
            0.0,
            30586259806659 / 12414158314087,
            -22760509404356 / 11113319521817,
            41 / 200,
        ],
        [
            218866479029 / 1489978393911,
            0.0,
            638256894668 / 5436446318841,
            -1179710474555 / 5321154724896,
            -60928119172 / 8023461067671,
            41 / 200,
        ],
        [
            1020004230633 / 5715676835656,
            0.0,
            25762820946817 / 25263940353407,
            -2161375909145 / 9755907335909,
            -211217309593 / 5846859502534,
            -4269925059573 / 7827059040749,
            41 / 200,
        ],
        [
            -872700587467 / 9133579230613,
            0.0,
            0.0,
            22348218063261 / 9555858737531,
            -1143369518992 / 8141816002931,
            -39379526789629 / 19018526304540,
            32727382324388 / 42900044865799,
            41 / 200,
        ],
    ]
    embedded = [
        -975461918565 / 9796059967033,
        0.0,
        0.0,
        78070527104295 / 32432590147079,
        -548382580838 / 3424219808633,
        -33438840321285 / 15594753105479,
        3629800801594 / 4656183773603,
        4035322873751 / 18575991585200,
    ]
    return _tableau(5, _lower(explicit), _lower(implicit), np.array(embedded))


_ORDER_4 = _order_4()
_ORDER_5 = _order_5()


def named(place: str, memory: dict[str, FloatArray]) -> ArmConstants:
    """Return the constants of an implicit step that an integrator keeps in its memory."""
    return ArmConstants(*(memory[f"{place}.{name}"] for name in ArmConstants._fields))


@dataclass(frozen=True)
class Additive(Integrator):
    """Common part of the additive methods.

    Args:
        step: the first step to try (s); None takes half a radian of the fastest mode.
    """

    step: float | None = None

    adaptive: ClassVar[bool] = True
    reference: ClassVar[tuple[str, ...]] = ("KennedyCarpenter2003", "BoscarinoFilbetRusso2016")
    tableau: ClassVar[AdditiveTableau]

    def advance(
        self,
        system: System,
        tolerance: Tolerance,
        progress: Progress,
        until: float,
        sample_times: FloatArray,
        samples: FloatArray,
        max_steps: int,
    ) -> Status:
        """See ``Integrator.advance``."""
        tableau = self.tableau
        memory = progress.memory
        if not memory:
            memory["clock"] = np.zeros(SOFTENED + 1)
            memory["clock"][STEP] = self.step or progress.step or 0.5 / tolerance.fastest
            memory["counts"] = np.zeros(4, dtype=np.int64)
            for name in ("smooth", "known"):
                memory[name] = np.zeros_like(progress.state)
            for name in ("added", "force"):
                memory[name] = np.zeros(progress.state.shape[1:])
            memory["torque"] = np.zeros(progress.state.shape[1])
            memory["no_error"] = np.zeros_like(tableau.error)
            memory["stages"] = np.zeros((len(tableau.c), *progress.state.shape))
            own = constants_to_soften(system.constants)
            memory |= {f"softened.{name}": array for name, array in own._asdict().items()}
        clock, counts = memory["clock"], memory["counts"]
        clock[TIME] = progress.time
        counts[0] = progress.sample
        status = progress.enter(
            advance_additive,
            system,
            named("softened", memory),
            tolerance,
            tableau.explicit,
            tableau.implicit,
            tableau.c,
            tableau.error,
            memory["no_error"],
            tableau.order,
            progress.state,
            memory["smooth"],
            memory["known"],
            memory["added"],
            memory["force"],
            memory["torque"],
            memory["stages"],
            clock,
            counts,
            float(until),
            sample_times,
            samples,
            max_steps,
        )
        progress.time, progress.step = float(clock[TIME]), float(clock[STEP])
        progress.impacts = int(clock[IMPACTS])
        progress.take(counts)
        return status


@dataclass(frozen=True)
class KennedyCarpenter4(Additive):
    """Order 4(3), 6 stages, L-stable in bending, damping, joint springs; dense order 4."""

    name = "kennedy_carpenter_4"
    order = 4
    tableau = _ORDER_4


@dataclass(frozen=True)
class KennedyCarpenter5(Additive):
    """Order 5(4), 8 stages, L-stable in bending, damping, joint springs; dense order 4."""

    name = "kennedy_carpenter_5"
    order = 5
    tableau = _ORDER_5
