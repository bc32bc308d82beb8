/* fmi2.c: functions of FMI 2.0, model exchange and co-simulation, over the model of fmu_core.h. */
#include "fmu_core.h"
#include "fmi2_interface.h"

typedef struct {
    FmuModel model;
    fmi2CallbackFunctions callbacks;
    char *name;
} Instance;

static fmi2Status status_of(Instance *own, const char *failure)
{
    if (!failure) {
        return fmi2OK;
    }
    if (own->callbacks.logger) {
        own->callbacks.logger(
            own->callbacks.componentEnvironment, own->name, fmi2Error, "logStatusError", "%s", failure);
    }
    return fmi2Error;
}

static fmi2Status missing(fmi2Component c, const char *failure)
{
    return status_of((Instance *)c, failure);
}

FMU_EXPORT const char *FMI2(fmi2GetTypesPlatform)(void)
{
    return fmi2TypesPlatform;
}

FMU_EXPORT const char *FMI2(fmi2GetVersion)(void)
{
    return fmi2Version;
}

FMU_EXPORT fmi2Status FMI2(fmi2SetDebugLogging)(
    fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    return fmi2OK;
}

FMU_EXPORT fmi2Component FMI2(fmi2Instantiate)(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *own = calloc(1, sizeof *own);
    size_t length = name ? strlen(name) : 0;
    if (!own || !(own->name = calloc(length + 1, 1))) {
        free(own);
        return NULL;
    }
    if (length) {
        memcpy(own->name, name, length);
    }
    if (functions) {
        own->callbacks = *functions;
    }
    if (!guid || strcmp(guid, FMU_TOKEN) != 0) {
        (void)status_of(own, "The GUID is not that of this binary: modelDescription.xml was changed.");
        free(own->name);
        free(own);
        return NULL;
    }
    fmu_reset(&own->model);
    return own;
}

FMU_EXPORT void FMI2(fmi2FreeInstance)(fmi2Component c)
{
    if (c) {
        free(((Instance *)c)->name);
        free(c);
    }
}

FMU_EXPORT fmi2Status FMI2(fmi2SetupExperiment)(
    fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
    fmi2Boolean stop_defined, fmi2Real stop)
{
    fmu_set_up(&((Instance *)c)->model, tolerance_defined, tolerance, start);
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2EnterInitializationMode)(fmi2Component c)
{
    ((Instance *)c)->model.phase = FMU_INITIALIZING;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2ExitInitializationMode)(fmi2Component c)
{
    ((Instance *)c)->model.phase = FMU_RUNNING;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2Terminate)(fmi2Component c)
{
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2Reset)(fmi2Component c)
{
    fmu_reset(&((Instance *)c)->model);
    return fmi2OK;
}

/* Values --------------------------------------------------------------------------------------- */

FMU_EXPORT fmi2Status FMI2(fmi2GetReal)(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[])
{
    Instance *own = c;
    return status_of(own, fmu_get(&own->model, vr, count, value));
}

FMU_EXPORT fmi2Status FMI2(fmi2SetReal)(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[])
{
    Instance *own = c;
    return status_of(own, fmu_set(&own->model, vr, count, value));
}

#define NO_VALUES(type)                                                                          \
    FMU_EXPORT fmi2Status FMI2(fmi2Get##type)(                                                   \
        fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2##type value[])        \
    {                                                                                            \
        return count ? missing(c, "All variables are of type Real.") : fmi2OK;                   \
    }                                                                                            \
    FMU_EXPORT fmi2Status FMI2(fmi2Set##type)(                                                   \
        fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2##type value[])  \
    {                                                                                            \
        return count ? missing(c, "All variables are of type Real.") : fmi2OK;                   \
    }

NO_VALUES(Integer)
NO_VALUES(Boolean)
NO_VALUES(String)

/* Saved states --------------------------------------------------------------------------------- */

FMU_EXPORT fmi2Status FMI2(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    Instance *own = c;
    if (*state) {
        *(FmuModel *)*state = own->model;
        return fmi2OK;
    }
    *state = fmu_copy(&own->model);
    return *state ? fmi2OK : missing(c, "No memory is left.");
}

FMU_EXPORT fmi2Status FMI2(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{
    ((Instance *)c)->model = *(FmuModel *)state;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2SerializedFMUstateSize)(
    fmi2Component c, fmi2FMUstate state, size_t *size)
{
    *size = sizeof(FmuModel);
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2SerializeFMUstate)(
    fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size < sizeof(FmuModel)) {
        return missing(c, "The size of a serialized state is wrong.");
    }
    memcpy(bytes, state, sizeof(FmuModel));
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2DeSerializeFMUstate)(
    fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    FmuModel model;
    if (size != sizeof model) {
        return missing(c, "The size of a serialized state is wrong.");
    }
    memcpy(&model, bytes, sizeof model);
    *state = fmu_copy(&model);
    return *state ? fmi2OK : missing(c, "No memory is left.");
}

FMU_EXPORT fmi2Status FMI2(fmi2GetDirectionalDerivative)(
    fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
    const fmi2ValueReference known[], size_t knowns, const fmi2Real along[], fmi2Real found[])
{
    return missing(c, "Directional derivatives are not provided.");
}

/* Model exchange ------------------------------------------------------------------------------- */

FMU_EXPORT fmi2Status FMI2(fmi2EnterEventMode)(fmi2Component c)
{
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info)
{
    double next = 0.0;
    memset(info, 0, sizeof *info);
    info->nextEventTimeDefined = fmu_sample_if_due(&((Instance *)c)->model, &next);
    info->nextEventTime = next;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2EnterContinuousTimeMode)(fmi2Component c)
{
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2CompletedIntegratorStep)(
    fmi2Component c, fmi2Boolean no_return, fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    *enter_event_mode = *terminate = fmi2False;
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2SetTime)(fmi2Component c, fmi2Real time)
{
    fmu_set_time(&((Instance *)c)->model, time);
    return fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_set_states(&own->model, x, count));
}

FMU_EXPORT fmi2Status FMI2(fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_derivatives(&own->model, derivatives, count));
}

FMU_EXPORT fmi2Status FMI2(fmi2GetEventIndicators)(fmi2Component c, fmi2Real value[], size_t count)
{
    return count ? missing(c, "There are no event indicators.") : fmi2OK;
}

FMU_EXPORT fmi2Status FMI2(fmi2GetContinuousStates)(fmi2Component c, fmi2Real x[], size_t count)
{
    Instance *own = c;
    return status_of(own, fmu_states(&own->model, x, count));
}

FMU_EXPORT fmi2Status FMI2(fmi2GetNominalsOfContinuousStates)(
    fmi2Component c, fmi2Real nominals[], size_t count)
{
    return status_of((Instance *)c, fmu_nominals(nominals, count));
}

/* Co-simulation -------------------------------------------------------------------------------- */

FMU_EXPORT fmi2Status FMI2(fmi2DoStep)(
    fmi2Component c, fmi2Real from, fmi2Real size, fmi2Boolean no_return)
{
    Instance *own = c;
    return status_of(own, fmu_do_step(&own->model, from + size));
}

FMU_EXPORT fmi2Status FMI2(fmi2CancelStep)(fmi2Component c)
{
    return missing(c, "Steps are not asynchronous.");
}

FMU_EXPORT fmi2Status FMI2(fmi2SetRealInputDerivatives)(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[],
    const fmi2Real value[])
{
    return missing(c, "Inputs are not interpolated.");
}

FMU_EXPORT fmi2Status FMI2(fmi2GetRealOutputDerivatives)(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[],
    fmi2Real value[])
{
    return missing(c, "Derivatives of outputs are not provided.");
}

#define NO_STATUS(name, type)                                                                    \
    FMU_EXPORT fmi2Status FMI2(name)(fmi2Component c, const fmi2StatusKind kind, type *value)    \
    {                                                                                            \
        return fmi2Discard;                                                                      \
    }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)

FMU_EXPORT fmi2Status FMI2(fmi2GetRealStatus)(
    fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = ((Instance *)c)->model.v[FMU_TIME];
    return fmi2OK;
}
