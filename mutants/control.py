"""The area of controllers, their design, their loops and filters."""

from __future__ import annotations

from mutants.groups import Area, Group

_MARGINS = "unit/control/test_loop_margins.py"

CONTROL = Area(
    mutants=30,
    groups=(
        Group(
            sources=("control/filters/**/*.py",),
            tests=(
                "unit/control/test_unscented_kalman.py",
                "unit/control/test_extended_kalman.py",
                "unit/control/test_filter_input.py",
                "unit/control/test_unknown_parameters.py",
                "unit/control/test_moving_horizon.py",
            ),
        ),
        Group(
            sources=("control/analysis/**/*.py",),
            tests=(
                "unit/control/test_loop_margins.py",
                "unit/control/test_loop_models.py",
                "unit/control/test_robustness.py",
                "simulate/test_loop_check.py",
            ),
        ),
        Group(
            sources=("simulation/loop/**/*.py",),
            tests=("simulate/test_hardware.py", "simulate/test_loop_check.py"),
        ),
        Group(
            sources=("control/**/loop_shaping.py", "control/**/robust_laws.py"),
            tests=("unit/control/test_loop_shaping.py", "unit/control/test_mu_synthesis.py"),
        ),
        Group(
            sources=("control/laws/strain_damping.py",),
            tests=("unit/control/test_strain_damping.py",),
        ),
        Group(
            sources=("control/laws/**/compensation.py",),
            tests=(
                "unit/control/test_repetitive.py",
                "unit/control/test_disturbance_observer.py",
            ),
        ),
        Group(
            sources=("control/**/input_shaping.py",),
            tests=("simulate/test_input_shaping.py",),
        ),
        Group(
            sources=(
                "control/**/lqg.py",
                "control/**/mpc.py",
                "control/**/linear_design.py",
                "control/**/nominal.py",
            ),
            tests=(
                "unit/control/test_lqg.py",
                "unit/control/test_nominal_motion.py",
                "unit/control/test_mpc_and_composite.py",
                f"{_MARGINS}::test_recovery_restores_the_margins_of_state_feedback",
            ),
        ),
        Group(
            sources=(
                "control/**/sliding*.py",
                "control/**/rigid_model.py",
            ),
            tests=(
                "unit/control/test_adaptive.py",
                "unit/control/test_rbf_adaptive.py",
                "unit/control/test_sliding_mode.py",
                "unit/control/test_position_laws.py",
            ),
        ),
        Group(
            sources=("control/contract/**/*.py",),
            tests=(
                "unit/control/test_feedforward.py",
                "unit/control/test_parametrised.py",
                "conformance/test_every_controller.py",
            ),
        ),
        Group(
            sources=("control/design/**/*.py", "control/laws/**/*.py"),
            tests=(
                "unit/control/test_position_laws.py",
                "unit/control/test_force_laws.py",
                "unit/control/test_task_space.py",
                "unit/control/test_disturbance_observer.py",
            ),
        ),
    ),
)
