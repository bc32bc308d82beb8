/* fmi3.c: functions of FMI 3.0, model exchange and co-simulation, over the model of fmu_core.h. */
#include "fmu_core.h"
#include "fmi3_interface.h"

typedef struct {
    FmuModel model;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Instance;

/* Arguments that the getters and setters of all types have. */
#define NAMED const fmi3ValueReference vr[], size_t count

static fmi3Status status_of(Instance *own, const char *failure)
{
    if (!failure) {
        return fmi3OK;
    }
    if (own->log) {
        own->log(own->environment, fmi3Error, "logStatusError", failure);
    }
    return fmi3Error;
}

static fmi3Status missing(fmi3Instance c, const char *failure)
{
    return status_of((Instance *)c, failure);
}

FMU_EXPORT const char *FMI3(fmi3GetVersion)(void)
{
    return fmi3Version;
}

FMU_EXPORT fmi3Status FMI3(fmi3SetDebugLogging)(
    fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    return fmi3OK;
}

static fmi3Instance instantiate(
    fmi3String token, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    Instance *own = calloc(1, sizeof *own);
    if (!own) {
        return NULL;
    }
    own->environment = environment;
    own->log = log;
    if (!token || strcmp(token, FMU_TOKEN) != 0) {
        (void)status_of(own, "The token is not that of this binary: modelDescription.xml was changed.");
        free(own);
        return NULL;
    }
    fmu_reset(&own->model);
    return own;
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return instantiate(token, environment, log);
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference required[],
    size_t count, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    return instantiate(token, environment, log);
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    if (log) {
        log(environment, fmi3Error, "logStatusError", "Scheduled execution is not provided.");
    }
    return NULL;
}

FMU_EXPORT void FMI3(fmi3FreeInstance)(fmi3Instance c)
{
    free(c);
}

FMU_EXPORT fmi3Status FMI3(fmi3EnterInitializationMode)(
    fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean stop_defined, fmi3Float64 stop)
{
    Instance *own = c;
    fmu_set_up(&own->model, tolerance_defined, tolerance, start);
    own->model.phase = FMU_INITIALIZING;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3ExitInitializationMode)(fmi3Instance c)
{
    ((Instance *)c)->model.phase = FMU_RUNNING;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3Reset)(fmi3Instance c)
{
    fmu_reset(&((Instance *)c)->model);
    return fmi3OK;
}

#define ACCEPTED(name)                                                                           \
    FMU_EXPORT fmi3Status FMI3(name)(fmi3Instance c)                                             \
    {                                                                                            \
        return fmi3OK;                                                                           \
    }

ACCEPTED(fmi3EnterEventMode)
ACCEPTED(fmi3Terminate)
ACCEPTED(fmi3EnterContinuousTimeMode)
ACCEPTED(fmi3EnterStepMode)
ACCEPTED(fmi3EvaluateDiscreteStates)
ACCEPTED(fmi3EnterConfigurationMode)
ACCEPTED(fmi3ExitConfigurationMode)

/* Values --------------------------------------------------------------------------------------- */

FMU_EXPORT fmi3Status FMI3(fmi3GetFloat64)(fmi3Instance c, NAMED, fmi3Float64 value[], size_t values)
{
    Instance *own = c;
    return status_of(own, fmu_get(&own->model, vr, count, value));
}

FMU_EXPORT fmi3Status FMI3(fmi3SetFloat64)(
    fmi3Instance c, NAMED, const fmi3Float64 value[], size_t values)
{
    Instance *own = c;
    return status_of(own, fmu_set(&own->model, vr, count, value));
}

#define NO_VALUES(type)                                                                          \
    FMU_EXPORT fmi3Status FMI3(fmi3Get##type)(                                                   \
        fmi3Instance c, NAMED, fmi3##type value[], size_t values)                                \
    {                                                                                            \
        return count ? missing(c, "All variables are of type Float64.") : fmi3OK;                \
    }                                                                                            \
    FMU_EXPORT fmi3Status FMI3(fmi3Set##type)(                                                   \
        fmi3Instance c, NAMED, const fmi3##type value[], size_t values)                          \
    {                                                                                            \
        return count ? missing(c, "All variables are of type Float64.") : fmi3OK;                \
    }

NO_VALUES(Float32)
NO_VALUES(Int8)
NO_VALUES(UInt8)
NO_VALUES(Int16)
NO_VALUES(UInt16)
NO_VALUES(Int32)
NO_VALUES(UInt32)
NO_VALUES(Int64)
NO_VALUES(UInt64)
NO_VALUES(Boolean)
NO_VALUES(String)

FMU_EXPORT fmi3Status FMI3(fmi3GetBinary)(
    fmi3Instance c, NAMED, size_t sizes[], fmi3Binary value[], size_t values)
{
    return count ? missing(c, "All variables are of type Float64.") : fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3SetBinary)(
    fmi3Instance c, NAMED, const size_t sizes[], const fmi3Binary value[], size_t values)
{
    return count ? missing(c, "All variables are of type Float64.") : fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3GetNumberOfVariableDependencies)(
    fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
    return missing(c, "Dependencies of elements are not provided.");
}

FMU_EXPORT fmi3Status FMI3(fmi3GetVariableDependencies)(
    fmi3Instance c, fmi3ValueReference dependent, size_t of_dependent[],
    fmi3ValueReference independents[], size_t of_independents[], fmi3DependencyKind kinds[],
    size_t count)
{
    return missing(c, "Dependencies of elements are not provided.");
}

/* Saved states --------------------------------------------------------------------------------- */

FMU_EXPORT fmi3Status FMI3(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *state)
{
    Instance *own = c;
    if (*state) {
        *(FmuModel *)*state = own->model;
        return fmi3OK;
    }
    *state = fmu_copy(&own->model);
    return *state ? fmi3OK : missing(c, "No memory is left.");
}

FMU_EXPORT fmi3Status FMI3(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state)
{
    ((Instance *)c)->model = *(FmuModel *)state;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *state)
{
    free(*state);
    *state = NULL;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3SerializedFMUStateSize)(
    fmi3Instance c, fmi3FMUState state, size_t *size)
{
    *size = sizeof(FmuModel);
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3SerializeFMUState)(
    fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    if (size < sizeof(FmuModel)) {
        return missing(c, "The size of a serialized state is wrong.");
    }
    memcpy(bytes, state, sizeof(FmuModel));
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3DeserializeFMUState)(
    fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    FmuModel model;
    if (size != sizeof model) {
        return missing(c, "The size of a serialized state is wrong.");
    }
    memcpy(&model, bytes, sizeof model);
    *state = fmu_copy(&model);
    return *state ? fmi3OK : missing(c, "No memory is left.");
}

#define NO_DERIVATIVE(name)                                                                      \
    FMU_EXPORT fmi3Status FMI3(name)(                                                            \
        fmi3Instance c, const fmi3ValueReference unknowns[], size_t unknown_count,               \
        const fmi3ValueReference knowns[], size_t known_count, const fmi3Float64 seed[],         \
        size_t seeds, fmi3Float64 found[], size_t sizes)                                         \
    {                                                                                            \
        return missing(c, "Directional derivatives are not provided.");                          \
    }

NO_DERIVATIVE(fmi3GetDirectionalDerivative)
NO_DERIVATIVE(fmi3GetAdjointDerivative)

/* Clocks, which the FMU does not have ---------------------------------------------------------- */

#define NO_CLOCK(name, ...)                                                                       \
    FMU_EXPORT fmi3Status FMI3(name)(fmi3Instance c, NAMED, __VA_ARGS__)                         \
    {                                                                                            \
        return count ? missing(c, "There are no clocks.") : fmi3OK;                              \
    }

NO_CLOCK(fmi3GetClock, fmi3Clock value[])
NO_CLOCK(fmi3SetClock, const fmi3Clock value[])
NO_CLOCK(fmi3GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NO_CLOCK(fmi3GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
    fmi3IntervalQualifier qualifiers[])
NO_CLOCK(fmi3GetShiftDecimal, fmi3Float64 shifts[])
NO_CLOCK(fmi3GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NO_CLOCK(fmi3SetIntervalDecimal, const fmi3Float64 intervals[])
NO_CLOCK(fmi3SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_CLOCK(fmi3SetShiftDecimal, const fmi3Float64 shifts[])
NO_CLOCK(fmi3SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

FMU_EXPORT fmi3Status FMI3(fmi3ActivateModelPartition)(
    fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    return missing(c, "There are no clocks.");
}

/* Model exchange ------------------------------------------------------------------------------- */

FMU_EXPORT fmi3Status FMI3(fmi3UpdateDiscreteStates)(
    fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
    fmi3Boolean *states_changed, fmi3Boolean *next_defined, fmi3Float64 *next)
{
    *again = *terminate = *nominals_changed = *states_changed = false;
    *next_defined = fmu_sample_if_due(&((Instance *)c)->model, next);
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3CompletedIntegratorStep)(
    fmi3Instance c, fmi3Boolean no_return, fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    *enter_event_mode = *terminate = false;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3SetTime)(fmi3Instance c, fmi3Float64 time)
{
    fmu_set_time(&((Instance *)c)->model, time);
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 x[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_set_states(&own->model, x, count));
}

FMU_EXPORT fmi3Status FMI3(fmi3GetContinuousStateDerivatives)(
    fmi3Instance c, fmi3Float64 derivatives[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_derivatives(&own->model, derivatives, count));
}

FMU_EXPORT fmi3Status FMI3(fmi3GetEventIndicators)(fmi3Instance c, fmi3Float64 value[], size_t count)
{
    return count ? missing(c, "There are no event indicators.") : fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3GetContinuousStates)(fmi3Instance c, fmi3Float64 x[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_states(&own->model, x, count));
}

FMU_EXPORT fmi3Status FMI3(fmi3GetNominalsOfContinuousStates)(
    fmi3Instance c, fmi3Float64 nominals[], size_t count)
{
    return status_of((Instance *)c, fmu_nominals(nominals, count));
}

FMU_EXPORT fmi3Status FMI3(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *count)
{
    *count = 0;
    return fmi3OK;
}

FMU_EXPORT fmi3Status FMI3(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *count)
{
    *count = FMU_STATES;
    return fmi3OK;
}

/* Co-simulation -------------------------------------------------------------------------------- */

FMU_EXPORT fmi3Status FMI3(fmi3GetOutputDerivatives)(
    fmi3Instance c, NAMED, const fmi3Int32 orders[], fmi3Float64 value[], size_t values)
{
    return missing(c, "Derivatives of outputs are not provided.");
}

FMU_EXPORT fmi3Status FMI3(fmi3DoStep)(
    fmi3Instance c, fmi3Float64 from, fmi3Float64 size, fmi3Boolean no_return,
    fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Instance *own = c;
    fmi3Status status = status_of(own, fmu_do_step(&own->model, from + size));
    *event_needed = *terminate = *early = false;
    *reached = own->model.v[FMU_TIME];
    return status;
}
