"""The areas of what is built on physics and control: runs, batches, data, optimal motions."""

from __future__ import annotations

from mutants.groups import Area, Group

APPLICATIONS: dict[str, Area] = {
    "runs": Area(
        mutants=20,
        groups=(
            Group(
                sources=("simulation/run/changes.py",),
                tests=("simulate/test_changes.py", "simulate/test_instants_of_changes.py"),
            ),
            Group(
                sources=("simulation/run/event*.py",),
                tests=("simulate/test_events.py", "simulate/test_event_arguments.py"),
            ),
            Group(
                sources=("simulation/run/contacts.py", "simulation/run/impacts.py"),
                tests=(
                    "simulate/test_contacts.py",
                    "simulate/test_rejected_contact_starts.py",
                    "simulate/test_joint_stops.py",
                ),
            ),
            Group(
                sources=(
                    "simulation/run/integrator_choice.py",
                    "simulation/run/tolerance.py",
                    "simulation/run/default_step.py",
                ),
                tests=(
                    "simulate/test_integrator_choice.py",
                    "simulate/test_default_step.py",
                    "simulate/test_accuracy_and_failure.py",
                ),
            ),
            Group(
                sources=("simulation/calls/compare.py", "simulation/calls/metrics.py"),
                tests=("simulate/test_compare.py",),
            ),
            Group(
                sources=("simulation/calls/separated.py",),
                tests=("simulate/test_separated.py",),
            ),
            Group(
                sources=("simulation/run/**/*.py", "simulation/calls/**/*.py"),
                tests=(
                    "simulate/test_results.py",
                    "simulate/test_section_channels.py",
                    "simulate/test_hardware.py",
                    "simulate/test_features_in_time.py",
                    "simulate/test_torques.py",
                    "simulate/test_plant.py",
                    "simulate/test_accuracy_and_failure.py",
                    "simulate/test_progress_bar.py",
                    "simulate/test_large_deflection.py",
                    "simulate/test_unresolved_modes.py",
                    "simulate/test_simulate_arguments.py",
                ),
            ),
        ),
    ),
    "batches and studies": Area(
        mutants=15,
        groups=(
            Group(
                sources=("simulation/batch/reductions.py",),
                tests=("simulate/test_batch_reductions.py",),
            ),
            Group(
                sources=("simulation/batch/**/*.py",),
                tests=(
                    "simulate/test_batch.py",
                    "simulate/test_batch_lanes.py",
                    "simulate/test_batch_loops.py",
                    "bridges/test_vector_environment.py",
                ),
            ),
            Group(
                sources=("cases/studies/**/*.py",),
                tests=(
                    "studies/test_samples.py",
                    "studies/test_study_statistics.py",
                    "studies/test_store.py",
                    "studies/test_batches_of_studies.py",
                    "studies/test_studies.py",
                ),
            ),
        ),
    ),
    "measured data": Area(
        mutants=15,
        groups=(
            Group(
                sources=("simulation/derivatives/gradient.py",),
                tests=("simulate/test_goal_gradient.py",),
            ),
            Group(
                sources=("simulation/derivatives/**/*.py",),
                tests=(
                    "simulate/test_sensitivities.py",
                    "simulate/test_sensitivities_of_events.py",
                    "simulate/test_sensitivities_of_loops.py",
                ),
            ),
            Group(
                sources=("identification/frequency/*.py",),
                tests=("identification/test_frequency.py",),
            ),
            Group(
                sources=("identification/assessment.py",),
                tests=("identification/test_planning.py",),
            ),
            Group(
                sources=("identification/**/*.py",),
                tests=(
                    "identification/test_reading.py",
                    "identification/test_filtering.py",
                    "identification/test_statistics.py",
                    "identification/test_identify.py",
                    "cli/test_identify_command.py",
                ),
            ),
        ),
    ),
    "learning and real time": Area(
        mutants=10,
        groups=(
            Group(
                sources=("planning/learning/**/*.py",),
                tests=("learning/test_iterative_learning.py",),
            ),
            Group(
                sources=("simulation/real_time/**/*.py",),
                tests=("simulate/test_realtime.py", "simulate/test_realtime_failures.py"),
            ),
        ),
    ),
    "optimal motions": Area(
        mutants=10,
        groups=(
            Group(
                sources=("planning/optimize/excitation.py",),
                tests=("identification/test_planning.py",),
            ),
            Group(
                sources=("planning/optimize/**/*.py",),
                tests=(
                    "optimize/test_limits.py",
                    "optimize/test_motion_and_errors.py",
                    "optimize/test_closed_forms.py",
                ),
            ),
        ),
    ),
}
