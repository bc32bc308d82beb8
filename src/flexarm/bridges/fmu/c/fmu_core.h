/* fmu_core.h: model behind the functions of FMI: values, samples of a controller, integration.
 *
 * All variables are numbers in one array `v`; a value reference is a place in it: time, the states,
 * their second derivatives, inputs, parameters, outputs. fmu_model.h has the sizes and equations.
 */
#ifndef FMU_CORE_H
#define FMU_CORE_H

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include "fmu_model.h"

#if defined(_WIN32)
#define FMU_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMU_EXPORT __attribute__((visibility("default")))
#else
#define FMU_EXPORT
#endif
#define FMU_PASTE(a, b) a##b
#define FMU_JOIN(a, b) FMU_PASTE(a, b)

#define FMU_TIME 0
#define FMU_STATES (2 * FMU_DOF)
#define FMU_STATE 1
#define FMU_ACCELERATION (1 + FMU_STATES)
/* Fraction of the sample time within which two times are equal. */
#define FMU_CLOSE 1e-9

typedef enum { FMU_CREATED, FMU_INITIALIZING, FMU_RUNNING } FmuPhase;

/* Everything that a saved state of the FMU contains. */
typedef struct {
    double v[FMU_VALUES];
    double memory[FMU_MEMORY + 1];
    double tolerance, step, start;
    double samples; /* of the controller so far */
    FmuPhase phase;
    int stale; /* whether accelerations and outputs belong to older values */
} FmuModel;

static void fmu_reset(FmuModel *m)
{
    memset(m, 0, sizeof *m);
    memcpy(m->v, fmu_start, sizeof m->v);
    m->tolerance = FMU_TOLERANCE;
    m->step = FMU_FIRST_STEP;
    m->stale = 1;
}

static void fmu_set_up(FmuModel *m, int tolerance_defined, double tolerance, double start)
{
    if (tolerance_defined && tolerance > 0.0) {
        m->tolerance = tolerance;
    }
    m->v[FMU_TIME] = m->start = start;
}

static void fmu_refresh(FmuModel *m)
{
    if (m->stale) {
        fmu_accelerations(m->v, m->v + FMU_STATE, m->v + FMU_STATE + FMU_DOF, m->v + FMU_ACCELERATION);
        fmu_outputs(m->v);
        m->stale = 0;
    }
}

/* The functions below return NULL, or the reason of a failure. */

static const char *fmu_get(FmuModel *m, const unsigned *reference, size_t count, double *value)
{
    size_t k;
    fmu_refresh(m);
    for (k = 0; k < count; ++k) {
        if (reference[k] >= FMU_VALUES) {
            return "A value reference does not exist.";
        }
        value[k] = m->v[reference[k]];
    }
    return NULL;
}

static const char *fmu_set(FmuModel *m, const unsigned *reference, size_t count, const double *value)
{
    size_t k;
    for (k = 0; k < count; ++k) {
        unsigned place = reference[k];
        int input = place >= FMU_INPUT && place < FMU_PARAMETER;
        int state = place >= FMU_STATE && place < FMU_ACCELERATION;
        int parameter = place >= FMU_PARAMETER && place < FMU_OUTPUT;
        if (!input && !state && !parameter) {
            return "A variable is neither an input, a parameter nor a state.";
        }
        if (!input && m->phase == FMU_RUNNING) {
            return "Parameters and initial states cannot be set after the initialization.";
        }
        m->v[place] = value[k];
    }
    m->stale = 1;
    return NULL;
}

static void fmu_set_time(FmuModel *m, double time)
{
    m->v[FMU_TIME] = time;
}

static const char *fmu_set_states(FmuModel *m, const double *states, size_t count)
{
    if (count != FMU_STATES) {
        return "The number of continuous states is wrong.";
    }
    memcpy(m->v + FMU_STATE, states, sizeof(double) * FMU_STATES);
    m->stale = 1;
    return NULL;
}

static const char *fmu_states(FmuModel *m, double *states, size_t count)
{
    if (count != FMU_STATES) {
        return "The number of continuous states is wrong.";
    }
    memcpy(states, m->v + FMU_STATE, sizeof(double) * FMU_STATES);
    return NULL;
}

static const char *fmu_derivatives(FmuModel *m, double *derivatives, size_t count)
{
    if (count != FMU_STATES) {
        return "The number of continuous states is wrong.";
    }
    fmu_refresh(m);
    memcpy(derivatives, m->v + FMU_STATE + FMU_DOF, sizeof(double) * FMU_STATES);
    return NULL;
}

static const char *fmu_nominals(double *nominals, size_t count)
{
    if (count != FMU_STATES) {
        return "The number of continuous states is wrong.";
    }
    memcpy(nominals, fmu_unit, sizeof(double) * FMU_STATES);
    return NULL;
}

/* Samples of the controller -------------------------------------------------------------------- */

#ifdef FMU_SAMPLE_TIME
static double fmu_next_sample(const FmuModel *m)
{
    return m->start + m->samples * FMU_SAMPLE_TIME;
}
#endif

/* Update the controller if a sample is due. Return whether another one follows, at time *next. */
static int fmu_sample_if_due(FmuModel *m, double *next)
{
#ifdef FMU_SAMPLE_TIME
    if (m->v[FMU_TIME] >= fmu_next_sample(m) - FMU_CLOSE * FMU_SAMPLE_TIME) {
        fmu_refresh(m);
        fmu_sample(m->v, m->memory, m->samples == 0.0);
        m->samples += 1.0;
        m->stale = 1;
    }
    *next = fmu_next_sample(m);
    return 1;
#else
    (void)m;
    (void)next;
    return 0;
#endif
}

/* Co-simulation -------------------------------------------------------------------------------- */

static void fmu_rates(FmuModel *m, const double *y, double *rates)
{
    memcpy(rates, y + FMU_DOF, sizeof(double) * FMU_DOF);
    fmu_accelerations(m->v, y, y + FMU_DOF, rates + FMU_DOF);
}

/* Set out = y + h * (weights' stages). */
static void fmu_combine(
    const double *y, double h, const double *weights, int count,
    double stages[FMU_STAGES + 1][FMU_STATES + 1], double *out)
{
    int i, k;
    for (i = 0; i < FMU_STATES; ++i) {
        double total = 0.0;
        for (k = 0; k < count; ++k) {
            total += weights[k] * stages[k][i];
        }
        out[i] = y[i] + h * total;
    }
}

/* Error of a step over the allowed one: two estimates, as in the integrator of flexarm, in metres
 * at the tip, relative to the largest coordinate or rate. */
static double fmu_error(
    const FmuModel *m, const double *y, const double *after, double h,
    double stages[FMU_STAGES + 1][FMU_STATES + 1])
{
    double worst = 0.0, worst_low = 0.0, check = 0.0;
    int level, i, k;
    for (level = 0; level < 2; ++level) {
        double size = 0.0, allowed;
        for (i = level * FMU_DOF; i < (level + 1) * FMU_DOF; ++i) {
            size = fmax(size, fmax(fabs(y[i]), fabs(after[i])) / fmu_unit[i]);
        }
        allowed = m->tolerance * (FMU_ABSOLUTE + size);
        for (i = level * FMU_DOF; i < (level + 1) * FMU_DOF; ++i) {
            double high = 0.0, low = 0.0;
            for (k = 0; k <= FMU_STAGES; ++k) {
                high += fmu_error_weights[0][k] * stages[k][i];
                low += fmu_error_weights[1][k] * stages[k][i];
            }
            worst = fmax(worst, fabs(h * high) / (fmu_unit[i] * allowed));
            worst_low = fmax(worst_low, fabs(h * low) / (fmu_unit[i] * allowed));
            check += 0.0 * high + 0.0 * after[i]; /* NaN if one of them is not finite */
        }
    }
    if (!(check == 0.0)) {
        return INFINITY;
    }
    return worst > 0.0 ? worst / sqrt(1.0 + 0.01 * pow(worst_low / worst, 2.0)) : 0.0;
}

/* Integrate to a time, with the inputs constant. */
static const char *fmu_integrate(FmuModel *m, double until)
{
    static const char failure[] = "No step is short enough for the tolerance: the motion diverges.";
    double stages[FMU_STAGES + 1][FMU_STATES + 1];
    double y[FMU_STATES + 1], after[FMU_STATES + 1], t = m->v[FMU_TIME];
    int k;
    memcpy(y, m->v + FMU_STATE, sizeof(double) * FMU_STATES);
    fmu_rates(m, y, stages[0]);
    while (t < until) {
        double left = until - t, norm, factor;
        int last = m->step >= left * (1.0 - 1e-9);
        double h = last ? left : m->step;
        for (k = 1; k < FMU_STAGES; ++k) {
            fmu_combine(y, h, fmu_weights[k], k, stages, after);
            fmu_rates(m, after, stages[k]);
        }
        fmu_combine(y, h, fmu_weights[FMU_STAGES], FMU_STAGES, stages, after);
        fmu_rates(m, after, stages[FMU_STAGES]);
        norm = fmu_error(m, y, after, h, stages);
        factor = norm > 0.0 ? fmin(5.0, fmax(0.2, 0.9 * pow(norm, -1.0 / FMU_ORDER))) : 5.0;
        if (norm <= 1.0) {
            t = last ? until : t + h;
            memcpy(y, after, sizeof(double) * FMU_STATES);
            memcpy(stages[0], stages[FMU_STAGES], sizeof stages[0]);
            /* A step that only ends at `until` says nothing against the longer one. */
            m->step = last ? fmax(m->step, h * factor) : h * factor;
        } else {
            m->step = h * factor;
            if (m->step < 1e-9 * FMU_FIRST_STEP) {
                return failure;
            }
        }
    }
    memcpy(m->v + FMU_STATE, y, sizeof(double) * FMU_STATES);
    m->v[FMU_TIME] = until;
    m->stale = 1;
    return NULL;
}

/* Carry out a communication step, with the samples of the controller within it. */
static const char *fmu_do_step(FmuModel *m, double until)
{
    while (m->v[FMU_TIME] < until) {
        double target = until, next;
        const char *failure;
#ifdef FMU_SAMPLE_TIME
        if (fmu_sample_if_due(m, &next) && next < until - FMU_CLOSE * FMU_SAMPLE_TIME) {
            target = next;
        }
#else
        (void)fmu_sample_if_due(m, &next);
#endif
        failure = fmu_integrate(m, target);
        if (failure) {
            return failure;
        }
    }
    return NULL;
}

static FmuModel *fmu_copy(const FmuModel *m)
{
    FmuModel *copy = malloc(sizeof *copy);
    if (copy) {
        *copy = *m;
    }
    return copy;
}

#endif
