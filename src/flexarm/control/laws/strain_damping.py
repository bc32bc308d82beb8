"""Damping of vibration by feedback of modal strains around a joint loop."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_times
from flexarm.base.errors import (
    InputError,
    Problem,
    UnstableLoopWarning,
    check_result,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import linalg, scipy
from flexarm.control.analysis.linear_controller import FrozenReference, LinearController
from flexarm.control.contract.base import (
    Around,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    SampledFeedforward,
    Step,
    applied,
    check_reference,
    is_law,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import check_sample_time
from flexarm.control.design.minimal import without_dry_friction
from flexarm.control.design.nominal import (
    FlexibleModel,
    Interpolated,
    PostureGrid,
    PreviewedReference,
    strain_matrix,
)
from flexarm.linear.models.linearize import linearize
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.linear.vibration.modal import modes
from flexarm.model.drives.around import (
    JOINT_CONTROLLERS,
    IntegralResonantControlParameters,
    OutputRedefinitionParameters,
    PositivePositionFeedbackParameters,
    StrainDampingParameters,
    WaveBasedControlParameters,
)
from flexarm.model.drives.base import ControllerParameters

#: Smallest singular value, relative to the largest one, at which strains distinguish modes and
#: joints move them independently.
_DISTINCT = 1e-6
#: Damping ratio below which a mode is reported, because joint loops damp it too little; and range
#: of frequencies in which a mode is recognised, relative to that without control, and frequency
#: relative to the range below which a pole is an integral.
_GROWING, _NEAR, _INTEGRAL = -0.005, 1.2, 1e-6


class StrainsAlong:
    """Strains (gauges,) of the bent arm along a reference that computes its bending."""

    vectorized = True

    def __init__(self, reference: Any, strains: FloatArray) -> None:
        self._reference, self._strains = reference, strains

    def __call__(self, t: ArrayLike) -> FloatArray:
        times = np.asarray(t, dtype=np.float64)
        found: FloatArray = self._reference.coordinates(times.reshape(-1))[0] @ self._strains.T
        return found.reshape(*times.shape, found.shape[-1])


class StrainDamping(StrainDampingParameters, OfArm, Around):
    """Base of controllers that damp the lowest modes by strain feedback around a joint loop.

    Strains that differ from those along the reference give the modal signals, (C.17). A subclass
    converts them to a motion of the joints, which is added to the reference of ``inner``. Along a
    reference of the flexible arm the strains are its own; along others, and without a reference,
    those of the statically bent arm.

    Raises:
        InputError: if a number is out of range, ``modes`` exceeds the number of joints, gauges or
            bending coordinates, the gauges do not distinguish the modes, the sample time of
            ``inner`` is too long for the arm, or ``inner`` plans the bending itself.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        UnstableLoopWarning: if a mode that is not damped, up to the one above the largest possible
            ``modes``, grows around joints that follow exactly.
    """

    _unsupported = None

    inner: Controller
    exports_plan = True
    compensates_friction = False

    def __post_init__(self) -> None:
        arm = self.arm
        self.posture = np.zeros(arm.n_joints) if self.posture is None else np.array(self.posture)
        limits = self._most_modes()
        most = min(limits.values())
        count = self.modes = max(1, most) if self.modes is None else self.modes
        if count > most:
            *others, last = [f"{there} {name}(s)" for name, there in limits.items()]
            rule = f"is {count}, but the arm has {', '.join(others)} and {last}"
            raise InputError(Problem("modes", rule, hint="Each mode requires one of each."))
        if not _of_joints(self.inner):
            rule = "be a controller of the joint angles, without a model of the bending"
            raise InputError(Problem("inner", rule, shown(self.inner)))
        rest = equilibrium(arm, self.posture)
        found = modes(arm, rest)
        shapes = found.shapes[:count]
        self.frequency_hz = found.frequency_hz[:count]
        self._strains = strain_matrix(arm)
        moved = shapes @ arm.mass_matrix(rest.q)[:, arm.joint_index]
        self._model = FlexibleModel(arm)
        self._observed = _inverse(self._strains @ shapes.T, "be observed by the gauges", count)
        self._driven = self._joint_motion(shapes, moved)
        elastic = self._model.elastic
        self._linear = model = linearize(without_dry_friction(arm), rest)
        stiffness = model.stiffness[np.ix_(elastic, elastic)]
        self._bend = self._strains[:, elastic] @ np.linalg.inv(stiffness)
        self._warn_of_growth(float(found.frequency_hz[: most + 1].max()))
        self._sag = Interpolated(PostureGrid(self.posture, None), [[rest.q[elastic]]])
        self.reset()

    def _most_modes(self) -> dict[str, int]:
        """Return the numbers that limit the number of modes, by their names."""
        arm = self.arm
        bending = arm.dof - arm.n_joints
        return {"joint": arm.n_joints, "gauge": len(arm.gauges), "bending coordinate": bending}

    def _joint_motion(self, shapes: FloatArray, moved: FloatArray) -> FloatArray:
        """Return the motion of the joints (joints, k) per motion in modal form, u of (C.17)."""
        return np.asarray(_inverse(moved, "be moved by the joints", len(moved)))

    @abstractmethod
    def _law(self, omega: FloatArray) -> LinearController:
        """Return the law for modes with angular frequencies omega (k,), rad/s.

        In continuous time, x' = A x + B y. The input y (k,) is the modal signal of (C.17), the
        output u is the motion (k,) of the joints in modal form, and its rate (k,).
        """

    @property
    def analytic(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts complex numbers, as that of the inner controller."""
        return is_law(self.inner) and self.inner.analytic

    def reset(self) -> None:
        super().reset()
        check_sample_time(self.arm, self.sample_time)
        law = self._law(2.0 * np.pi * self.frequency_hz)
        joints = np.kron(np.eye(2), self._driven)
        B, D = -law.B @ self._observed, -law.D @ self._observed
        whole = law.A, B, joints @ law.C, joints @ D
        # Tustin's rule, because a zero-order hold of the strain would delay the feedback.
        self._A, self._B, self._C, self._D, _ = scipy.signal.cont2discrete(
            whole, self.sample_time, "bilinear"
        )
        self._followed: Reference | None = None
        self._along: SampledFeedforward | None = None
        model = self._model, self._sag, self.sample_time
        self._nominal = PreviewedReference(*model, 1, self._static_strain)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        required = self._required(arm, reference, self.arm.n_joints)
        read = tuple(dict.fromkeys([*required.measured, "strain"]))
        return ControllerRequirements(required.joints, read, len(self.arm.gauges))

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the inputs of the inner controller, and the nominal motion with its strains."""
        nominal = self._nominal.at(t, reference)
        if reference is not self._followed:
            self._followed, self._along = reference, None
            if _bends(reference):  # it computes its strains
                strains = StrainsAlong(reference, self._strains)
                self._along = SampledFeedforward(strains, self.sample_time)
        if self._along is None:
            strain = nominal.shown + applied(self._bend, nominal.missing)
        else:
            strain = self._along(t)
        outer = {"outer_angle": nominal.angle, "outer_rate": nominal.qd[self.arm.joint_index]}
        return {**super().planned(t, reference), "nominal_strain": strain, **outer}

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"state": np.zeros(len(self._A)), **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        state, strain = memory["state"], readings.strain - inputs["nominal_strain"]
        motion = applied(self._C, state) + applied(self._D, strain)
        m = self.arm.n_joints
        shifted = {**inputs, "reference_angle": inputs["outer_angle"] + motion[:m]}
        shifted["reference_rate"] = inputs["outer_rate"] + motion[m:]
        inside, torque = self._inner_step(memory, readings, shifted)
        return {"state": applied(self._A, state) + applied(self._B, strain), **inside}, torque

    @public_call
    def strain_correction(self, t: ArrayLike, reference: Reference) -> FloatArray:
        """Return the strains of a reference minus those of the static bending of the links.

        The exported C function computes the static bending at the angles, rates and accelerations
        of the reference. This is its input for a reference that computes its own bending.

        Args:
            t: time, or times (T,), s.
            reference: the reference.

        Returns:
            Strains (gauges,), or (T, gauges) at times (T,); zero for references without bending.

        Raises:
            InputError: if the times are not numbers, or the reference lacks a method.
        """
        times = check_times("t", t)
        check_reference(reference)
        found = np.zeros((times.size, len(self._strains)))
        if _bends(reference) and times.size:
            flat = times.reshape(-1)
            parts = reference.joint_angle, reference.joint_rate, reference.joint_acceleration
            motion = [np.array([part(one) for one in flat.tolist()]) for part in parts]
            static = self._nominal.along(*motion)
            found = StrainsAlong(reference, self._strains)(flat) - static.shown
            found -= static.missing @ self._bend.T
        return found.reshape(*times.shape, found.shape[-1])

    def _warn_of_growth(self, highest: float) -> None:
        """Warn if a mode that is not designed grows around joints that follow exactly."""
        elastic, count, model = self._model.elastic, self.modes, self._linear
        n, law = len(elastic), self._law(2.0 * np.pi * self.frequency_hz)
        own = np.ix_(elastic, elastic)
        signal = -law.B @ self._observed @ self._strains[:, elastic]
        # The angles have no feedthrough, so their accelerations follow from the state of the law.
        push = -model.mass[np.ix_(elastic, self.arm.joint_index)] @ self._driven @ law.C[:count]
        forces = (
            push @ law.A @ signal - model.stiffness[own],
            push @ signal - model.damping[own],
            push @ law.A @ law.A,
        )
        none = np.zeros((n, n))
        rates = [none, np.eye(n), np.zeros((n, len(law.A)))]
        accelerations = [np.linalg.solve(model.mass[own], np.hstack(forces))]
        loop = np.block([rates, accelerations, [signal, np.zeros((len(law.A), n)), law.A]])
        poles = np.linalg.eigvals(check_result(loop, law.A))
        limit = _NEAR * 2.0 * np.pi * highest
        # Integrals of the law have poles at zero.
        poles = poles[(np.abs(poles) < limit) & (np.abs(poles) > _INTEGRAL * limit)]
        worst = poles[np.argmax(poles.real / np.abs(poles))]
        ratio, hertz = -worst.real / abs(worst), abs(worst) / (2.0 * np.pi)
        if ratio < _GROWING:
            text = (
                f"With modes={count}, a mode of {hertz:.3g} Hz that is not damped grows if the "
                f"joints follow exactly: its damping ratio is {ratio:.2g}. Choose another number "
                "of modes or a smaller damping_ratio, and check the loop with flexarm.loop_margins."
            )
            warn_caller(text, UnstableLoopWarning)

    def _static_strain(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the strains (T, gauges) at q (T, dof)."""
        shown: FloatArray = q @ self._strains.T
        return shown


def _bends(reference: Reference | None) -> bool:
    """Return whether the strains of a reference are its own."""
    # For small deviations from a constant reference it does not matter which strains it has.
    return hasattr(reference, "coordinates") and not isinstance(reference, FrozenReference)


def _of_joints(controller: Any) -> bool:
    """Return whether a controller, or the innermost one in it, is one of the joint angles."""
    while not isinstance(controller, StrainDamping):
        inner = getattr(controller, "inner", None)
        if inner is None:
            # The kind of a user's controller is unknown, so it is accepted.
            own = not isinstance(controller, ControllerParameters)
            return own or controller.name in JOINT_CONTROLLERS
        controller = inner
    return False


def _inverse(matrix: FloatArray, rule: str, count: int) -> Any:
    """Return the pseudoinverse of a matrix of full rank."""
    sizes = np.linalg.svd(matrix, compute_uv=False)
    if sizes[-1] <= _DISTINCT * sizes[0]:
        raise InputError(Problem("modes", rule, str(count)))
    return np.linalg.pinv(matrix)


class PositivePositionFeedback(PositivePositionFeedbackParameters, StrainDamping):
    """Positive position feedback: a resonant filter for each mode moves the joints.

    Each filter has the frequency of its mode and twice the requested damping ratio; its gain makes
    both poles of mode and filter equal, (C.18). The filter attenuates strains above its
    frequency, so higher modes are hardly affected. The reference is moved by the filtered strain
    and its rate.

    The design assumes that the joints follow their reference at the frequency of the mode. The
    inner controller must act on the joint angles of its reference. The arm needs one gauge for
    each mode.
    """

    references: ClassVar[str] = "GohCaughey1985 FansonCaughey1990"

    def _law(self, omega: FloatArray) -> LinearController:
        """See `StrainDamping._law`; (C.18)."""
        count = len(omega)
        one, zero = np.eye(count), np.zeros((count, count))
        ratio = 2.0 * self.damping_ratio
        stiffness, damping = np.diag(omega**2), np.diag(2.0 * ratio * omega)
        A, B = np.block([[zero, one], [-stiffness, -damping]]), np.vstack([zero, stiffness])
        return LinearController(A, B, -(ratio**2) * np.eye(2 * count), np.zeros((2 * count, count)))


class IntegralResonantControl(IntegralResonantControlParameters, StrainDamping):
    """Integral resonant control: the integral of the strain of each mode moves the joints.

    A feedthrough from the motion of the joints to the integrated signal places a zero below each
    mode, at the frequency of the mode divided by 1 + 2 ``damping_ratio``. The gain is that of the
    largest damping, (C.19). The feedthrough returns the joints to the reference, so
    constant strains that the model does not explain do not accumulate.

    The design assumes that the joints follow their reference at the frequency of the mode. The
    inner controller must act on the joint angles of its reference. The arm needs one gauge for
    each mode. Around one link the law damps higher modes as well. With several links modes
    that are not damped can grow: compare ``modes`` up to the number of joints by `loop_margins`.
    """

    references: ClassVar[str] = "AphaleEtAl2007 PereiraEtAl2011 NamavarEtAl2014"

    def _law(self, omega: FloatArray) -> LinearController:
        """See `StrainDamping._law`; (C.19)."""
        count = len(omega)
        ratio = 1.0 + 2.0 * self.damping_ratio  # of the frequencies of pole and zero
        through = 1.0 / (ratio**2 - 1.0)
        gain = np.diag(omega * np.sqrt(ratio) / (1.0 + through))
        one = np.eye(count)
        outputs = np.vstack([one, -through * gain]), np.vstack([0.0 * one, -gain])
        return LinearController(-through * gain, -gain, *outputs)


class WaveBasedControl(WaveBasedControlParameters, StrainDamping):
    """Wave-based control: the joints launch the reference as a wave and absorb what returns.

    Half of the reference is launched, and the returning wave, measured by the strains, is added.
    The moment of the links then moves the joints as a damper would. A damping ratio of 0.5 is the
    matched impedance. Theory page "position control", section 7. Without ``leakage``, as in the
    source, the joints return to the reference after a motion from rest to rest, but constant
    strains that the model does not explain turn them without limit.

    The design assumes that the joints follow their reference at the frequency of the mode. The
    inner controller must act on the joint angles of its reference. The arm needs one gauge for
    each mode.
    """

    references: ClassVar[str] = "OConnor2007"

    def _law(self, omega: FloatArray) -> LinearController:
        one = np.eye(len(omega))
        gain, leak = np.diag(2.0 * self.damping_ratio * omega), np.diag(self.leakage * omega)
        outputs = np.vstack([one, -leak]), np.vstack([0.0 * one, -gain])
        return LinearController(-leak, -gain, *outputs)


#: Vibrations of the arm with free joints have at least this frequency, relative to the highest one.
_RIGID = 1e-5


class OutputRedefinition(OutputRedefinitionParameters, StrainDamping):
    """Joint angles plus a fraction of the bending, as the angles that an inner loop controls.

    The chord of a link connects its joint with the next one, or with the tip. Bending rotates it,
    and ``weight`` times this rotation, from the strains, is added to the joint angle, through a
    low-pass filter. Weights near one return the tip to its reference under loads and payloads that
    the model does not explain; the filter keeps vibration out of this feedback.

    With a cutoff far above the modes, weights between 0 and 1 are the output of Madhavan and Singh
    and of Damaren, and -1 is the reflected tip of Wang and Vidyasagar. `damping_weights` returns
    the range in which small gains damp every mode. Such feedback rarely damps more than the inner
    loop alone: compare by `loop_margins`, and see `IntegralResonantControl` for damping.

    Raises:
        InputError: if a number is out of range, ``modes`` exceeds the number of gauges or bending
            coordinates, the gauges do not distinguish the modes, or ``inner`` plans the bending
            itself.
        EquilibriumError: if the arm has no equilibrium at the posture.
    """

    references: ClassVar[str] = "WangVidyasagar1992 MadhavanSingh1991 Damaren1995"

    def _most_modes(self) -> dict[str, int]:
        return {
            "gauge": len(self.arm.gauges),
            "bending coordinate": self.arm.dof - self.arm.n_joints,
        }

    def _joint_motion(self, shapes: FloatArray, moved: FloatArray) -> FloatArray:
        """Return the rotations (joints, modes) of the chords relative to each other, rad."""
        return self._model.chords(np.asarray(self.posture)) @ shapes[:, self._model.elastic].T

    def _law(self, omega: FloatArray) -> LinearController:
        one = np.eye(len(omega))
        hertz = 0.05 * self.frequency_hz[0] if self.cutoff is None else self.cutoff
        passed, share = 2.0 * np.pi * hertz * one, self.weight * one
        change = share @ passed
        outputs = np.vstack([share, -change]), np.vstack([0.0 * one, change])
        return LinearController(-passed, passed, *outputs)

    def _warn_of_growth(self, highest: float) -> None:
        """Do nothing: a loop that does not follow exactly provides the damping."""

    @public_call
    def damping_weights(self) -> tuple[float, float]:
        """Return the range of weights for which small rate gains at any joint damp every mode.

        For one joint this is the range in which the redefined rate is a passive output of the
        torque. Zero is within it. The bending is that which the gauges determine, without a filter.
        """
        model = self._linear
        stiffness, shapes = linalg.eigh(model.stiffness, model.mass)
        shapes = shapes[:, stiffness > _RIGID**2 * stiffness[-1]]
        turned = shapes[self.arm.joint_index]
        bent = self._driven @ self._observed @ self._strains @ shapes
        # The joint loses energy in a mode if turned * (turned + weight * bent) is positive.
        product = turned * bent
        limits = -(turned[product != 0.0] ** 2) / product[product != 0.0]
        lowest = np.max(limits[limits < 0.0], initial=-np.inf)
        return float(lowest), float(np.min(limits[limits > 0.0], initial=np.inf))
