"""The areas of the code that `make mutants` examines, and the tests that belong to each.

Globs of sources find a file by its name in every subfolder. The first group with a file has it.
Tests that fail most often for errors of the group come first, because pytest stops at a failure.
"""

from __future__ import annotations

from mutants.applications import APPLICATIONS
from mutants.control import CONTROL
from mutants.groups import Area, Group

_SURFACES = "unit/contacts/test_surfaces.py"
_INVERSE = "invariants/test_forward_and_inverse.py"
_ADAPTIVE = "unit/control/test_adaptive.py"
_INTEGRATOR = "conformance/test_every_integrator.py"

AREAS: dict[str, Area] = {
    "kernels": Area(
        mutants=40,
        # They make and keep machine code; plain Python runs without them.
        without=(
            "kernels/**/cache.py",
            "kernels/**/code_*.py",
            "kernels/**/compile_notice.py",
        ),
        groups=(
            # They change how kernels are compiled, and have no effect in plain Python.
            Group(
                sources=(
                    "kernels/compilation/dual*.py",
                    "kernels/compilation/fused.py",
                    "kernels/compilation/packs.py",
                ),
                tests=(
                    "unit/kernels/test_packs.py",
                    "unit/kernels/test_duals.py",
                    "simulate/test_batch_lanes.py",
                ),
            ),
            Group(
                sources=("kernels/**/contact.py", "kernels/**/surface.py"),
                tests=(
                    "unit/contacts/test_contact_places.py",
                    "unit/contacts/test_surfaces.py",
                    "unit/linear/test_linear_contacts.py",
                ),
                plain=True,
            ),
            Group(
                sources=(
                    "kernels/**/rigid_terms.py",
                    "kernels/**/task_dynamics.py",
                    "kernels/**/adaptation.py",
                ),
                tests=(
                    "unit/control/test_rigid_model.py",
                    "unit/control/test_task_space.py",
                    f"{_ADAPTIVE}::test_regressor_columns_add_up_to_the_inverse_dynamics",
                    f"{_ADAPTIVE}::test_regressor_column_is_the_effect_of_a_unit_of_its_parameter",
                    f"{_ADAPTIVE}::test_centrifugal_matrix_has_christoffel_symbols",
                ),
                plain=True,
            ),
            Group(
                sources=(
                    "kernels/**/*sensitivity.py",
                    "kernels/**/tangent.py",
                    "kernels/**/tip_motion.py",
                    "kernels/**/point_motion.py",
                ),
                tests=(
                    "unit/control/test_predicted_readings.py",
                    "unit/kernels/test_sensitivity.py",
                    "unit/linear/test_linear_signals.py",
                ),
                plain=True,
            ),
            Group(
                sources=("kernels/**/section_forces.py", "kernels/**/shapes.py"),
                tests=(
                    "unit/stations/test_section_statics.py",
                    "unit/stations/test_section_closed_forms.py",
                    "oracle_comparison/test_section_forces_oracle.py",
                ),
                plain=True,
            ),
            Group(
                sources=("kernels/**/*.py",),
                tests=(
                    "oracle_comparison/test_every_option_oracle.py",
                    "oracle_comparison/test_forward_dynamics_oracle.py",
                    f"{_INVERSE}::test_inverse_of_forward_is_the_torque_without_modal_forces",
                    "oracle_comparison/test_implicit_solve.py",
                    "unit/kernels/test_joint_laws.py",
                    "unit/kernels/test_columns.py",
                ),
                plain=True,
            ),
        ),
    ),
    "integrators": Area(
        mutants=30,
        groups=(
            Group(
                sources=(
                    "integrate/**/*tableau.py",
                    "integrate/**/order_conditions.py",
                    "integrate/**/dop853.py",
                    "integrate/**/kennedy_carpenter.py",
                ),
                tests=("conformance/test_every_tableau.py", "unit/integrate/test_dop853.py"),
                plain=True,
            ),
            Group(
                sources=("integrate/lanes/*.py",),
                tests=("simulate/test_batch_lanes.py",),
            ),
            Group(
                sources=("integrate/transfers.py",),
                tests=("simulate/test_goal_gradient.py",),
            ),
            Group(
                sources=("integrate/**/nearness.py",),
                tests=("unit/integrate/test_nearness.py", "simulate/test_contacts.py"),
            ),
            Group(
                sources=("integrate/**/newmark.py",),
                tests=("unit/integrate/test_generalized_alpha.py", "conformance/test_few_steps.py"),
                plain=True,
            ),
            Group(
                sources=("integrate/**/joint_stops.py", "integrate/**/switching.py"),
                tests=(
                    "unit/integrate/test_switching.py",
                    "simulate/test_joint_stops.py::test_restitution_of_hunt_and_crossley",
                    "simulate/test_joint_stops.py::test_steps_end_at_the_corner_of_a_stop",
                ),
                plain=True,
            ),
            Group(
                sources=("integrate/**/step_sensitivity.py",),
                tests=(
                    "unit/linear/test_sampled_step.py",
                    "unit/linear/test_step_jacobian.py::test_derivatives_by_state_and_torque",
                ),
                plain=True,
            ),
            Group(
                sources=("integrate/**/*.py",),
                tests=(
                    "unit/integrate/test_steps.py",
                    "conformance/test_few_steps.py",
                    f"{_INTEGRATOR}::test_steps_end_at_stops_with_the_torque_of_the_correct_side",
                    f"{_INTEGRATOR}::test_contacts_are_simulated_or_rejected",
                    f"{_INTEGRATOR}::test_accuracy_beyond_double_precision_is_rejected",
                ),
                plain=True,
            ),
        ),
    ),
    "control": CONTROL,
    "linear": Area(
        mutants=25,
        groups=(
            Group(
                sources=("linear/**/equilibrium.py",),
                tests=(
                    "unit/linear/test_equilibrium.py",
                    "unit/linear/test_reprs.py",
                    "unit/linear/test_modes.py",
                ),
            ),
            Group(
                sources=("linear/bent_references.py",),
                tests=("simulate/test_flexible_references.py", "unit/linear/test_pressed.py"),
            ),
            Group(sources=("linear/**/tracking.py",), tests=("unit/linear/test_tracking.py",)),
            Group(
                sources=("linear/**/state_space.py",),
                tests=("unit/linear/test_transfer.py", "unit/linear/test_linear_signals.py"),
            ),
            Group(
                sources=("linear/**/along.py",),
                tests=("unit/linear/test_linearize_along.py", "simulate/test_separated.py"),
            ),
            Group(
                sources=(
                    "linear/**/*step*.py",
                    "linear/**/parameters.py",
                ),
                tests=("unit/linear/test_sampled_step.py", "unit/linear/test_step_jacobian.py"),
            ),
            Group(
                sources=("linear/**/*.py",),
                tests=(
                    "unit/linear/test_modes.py",
                    "unit/linear/test_linear_signals.py",
                    "unit/linear/test_linearize.py",
                    "unit/linear/test_linear_contacts.py",
                    "unit/linear/test_reprs.py",
                ),
            ),
        ),
    ),
    "files": Area(
        mutants=30,
        groups=(
            Group(
                sources=(
                    "model/**/yaml_text.py",
                    "model/**/files.py",
                    "model/**/paths.py",
                ),
                tests=(
                    "unit/model/test_yaml_text.py",
                    "unit/model/test_model_files.py",
                    "unit/model/test_paths.py",
                    "unit/model/test_model_spec.py",
                ),
            ),
            Group(
                sources=(
                    "model/**/links.py",
                    "model/arm/joints.py",
                    "model/arm/mechanism.py",
                    "model/arm/spec.py",
                ),
                tests=(
                    "unit/model/test_model_links.py",
                    "conformance/test_every_section.py",
                    "unit/model/test_model_sections.py",
                    "unit/model/test_model_shear.py",
                    "unit/model/test_model_joints.py",
                    "unit/model/test_variation.py",
                    "unit/model/test_model_spec.py",
                    "unit/model/test_model_files.py",
                ),
            ),
            Group(
                sources=("model/identification.py",),
                tests=("identification/test_reading.py", "cli/test_identify_command.py"),
            ),
            Group(
                sources=("model/scenarios/study.py",),
                tests=(
                    "studies/test_samples.py",
                    "studies/test_studies.py",
                    "unit/model/test_model_study.py",
                ),
            ),
            Group(
                sources=("model/environment.py",),
                tests=(
                    f"{_SURFACES}::test_closed_line_that_crosses_itself_is_rejected",
                    f"{_SURFACES}::test_crossing_is_the_first_of_all_pairs",
                    "unit/model/test_contact_specs.py",
                    "unit/model/test_model_loads.py",
                    "simulate/test_changes.py",
                    "simulate/test_changes_of_runs.py",
                ),
            ),
            Group(
                sources=("model/**/*.py",),
                tests=(
                    "unit/model/test_model_drives.py",
                    "unit/model/test_model_scenario.py",
                    "unit/model/test_model_hardware.py",
                    "unit/model/test_help_text.py",
                    "unit/model/test_model_schema.py",
                    "unit/model/test_model_files.py",
                    "unit/model/test_model_spec.py",
                ),
            ),
        ),
    ),
    "command line": Area(
        mutants=20,
        # What `flexarm warmup` compiles: a test of it compiles every kernel.
        without=("cli/**/features.py",),
        groups=(
            Group(
                sources=("cli/**/modes.py", "cli/**/linearize.py"),
                tests=("cli/test_linear_commands.py",),
            ),
            Group(sources=("cli/**/compare.py",), tests=("cli/test_compare_command.py",)),
            Group(
                sources=("cli/**/run.py",),
                tests=("cli/test_first_minutes.py", "cli/test_commands.py"),
            ),
            Group(sources=("cli/**/identify.py",), tests=("cli/test_identify_command.py",)),
            Group(sources=("cli/**/studio.py",), tests=("cli/test_studio_command.py",)),
            Group(sources=("cli/**/sweep.py",), tests=("cli/test_sweep_command.py",)),
            Group(
                sources=("cli/**/export*.py",),
                tests=(
                    "bridges/test_c_code.py::test_command",
                    "bridges/test_fmu.py::test_command",
                    "bridges/test_matlab.py",
                ),
            ),
            Group(sources=("cli/**/warmup.py",), tests=("cli/test_warmup.py",)),
            Group(
                sources=("cli/**/init.py", "cli/**/check.py"),
                tests=("cli/test_first_minutes.py",),
            ),
            Group(
                sources=("cli/**/*.py",),
                tests=(
                    "cli/test_commands.py",
                    "cli/test_wrong_input.py",
                    "cli/test_report_command.py",
                    "cli/test_paper_command.py",
                ),
            ),
        ),
    ),
    **APPLICATIONS,
}
