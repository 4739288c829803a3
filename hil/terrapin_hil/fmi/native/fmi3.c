/* The functions of FMI 3.0 over fmu.h. What a co-simulation without events, clocks, strings and derivatives never needs
 * answers fmi3Error. */
#include "fmi3.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu.h"
#include "limits.inc"

#define TICK    1e-3
#define LONGEST 1000000.0 /* ticks of one step */

typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmu_model model;
} instance_t;

static fmi3Status refuse(const instance_t *instance, const char *what) {
    if (instance->log != NULL) {
        instance->log(instance->environment, fmi3Error, "logStatusError", what);
    }
    return fmi3Error;
}

FMI3_EXPORT const char *fmi3GetVersion(void) {
    return "3.0";
}

FMI3_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String names[]) {
    (void)instance, (void)on, (void)n, (void)names;
    return fmi3OK;
}

FMI3_EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                     fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                                     fmi3Boolean early, const fmi3ValueReference required[],
                                                     size_t n_required, fmi3InstanceEnvironment environment,
                                                     fmi3LogMessageCallback log, void *intermediate) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required;
    (void)n_required, (void)intermediate;
    instance_t *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return NULL;
    }
    made->environment = environment;
    made->log = log;
    if ((token == NULL) || (strcmp(token, FMU_TOKEN) != 0)) {
        (void)refuse(made, "the instantiation token is that of another model description");
        free(made);
        return NULL;
    }
    fmu_defaults(&made->model);
    return made;
}

FMI3_EXPORT void fmi3FreeInstance(fmi3Instance instance) {
    free(instance);
}

FMI3_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                                   fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stop_defined,
                                                   fmi3Float64 stop) {
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    instance_t *me = instance;
    me->model.float64[0] = start;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    instance_t *me = instance;
    const char *wrong = fmu_start(&me->model);
    if (wrong != NULL) {
        char text[160];
        (void)snprintf(text, sizeof text, "parameter %s: out of its range", wrong);
        return refuse(me, text);
    }
    me->model.ready = true;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3Terminate(fmi3Instance instance) {
    (void)instance;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3Reset(fmi3Instance instance) {
    fmu_defaults(&((instance_t *)instance)->model);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_set_state,
                                  fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    (void)no_set_state;
    instance_t *me = instance;
    fmu_model *model = &me->model;
    *event = *terminate = *early = false;
    const double ticks = rint(size / TICK);
    if (!model->ready || !(ticks >= 1.0) || (ticks > LONGEST) || (fabs(size - ticks * TICK) > 1e-6 * TICK)) {
        return refuse(me, "a step is whole milliseconds, after the initialisation");
    }
    fmu_advance(model, (uint32_t)ticks);
    model->ticks += (uint32_t)ticks;
    model->float64[0] = *last = time + size;
    return fmi3OK;
}

/* -- values -------------------------------------------------------------------------------------------------------- */

static bool outside(double value, double low, double high) {
    return !(value >= low && value <= high);
}

static fmi3Status refuse_value(const instance_t *instance, fmi3ValueReference reference, double value, double low,
                               double high) {
    char text[160];
    (void)snprintf(text, sizeof text, "value reference %u: found %g, expected %g to %g", (unsigned)reference, value,
                   low, high);
    return refuse(instance, text);
}

/* Parameters until the model is ready, inputs always; `settable` of them stand first, after the time. */
#define VALUES(NAME, TYPE, FIELD, BASE, COUNT, FIRST, PARAMETERS, INPUTS, LOW, HIGH)                                   \
    FMI3_EXPORT fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference references[], size_t n,       \
                                         TYPE values[], size_t n_values) {                                             \
        instance_t *me = instance;                                                                                     \
        for (size_t i = 0; i < n; i++) {                                                                               \
            const uint32_t at = references[i] - (uint32_t)(BASE);                                                      \
            if ((at >= (uint32_t)(COUNT)) || (i >= n_values)) {                                                        \
                return refuse(me, "no variable of type " #NAME " has this value reference");                           \
            }                                                                                                          \
            values[i] = me->model.FIELD[at];                                                                           \
        }                                                                                                              \
        return fmi3OK;                                                                                                 \
    }                                                                                                                  \
    FMI3_EXPORT fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference references[], size_t n,       \
                                         const TYPE values[], size_t n_values) {                                       \
        instance_t *me = instance;                                                                                     \
        for (size_t i = 0; i < n; i++) {                                                                               \
            const uint32_t at = references[i] - (uint32_t)(BASE) - (uint32_t)(FIRST);                                  \
            if ((at >= (uint32_t)(PARAMETERS) + (uint32_t)(INPUTS)) || (i >= n_values)) {                              \
                return refuse(me, "no " #NAME " that can be set has this value reference");                            \
            }                                                                                                          \
            if (me->model.ready && (at < (uint32_t)(PARAMETERS))) {                                                    \
                return refuse(me, "a parameter is fixed once the FMU is initialised");                                 \
            }                                                                                                          \
            if (outside((double)values[i], (LOW), (HIGH))) {                                                           \
                return refuse_value(me, references[i], (double)values[i], (LOW), (HIGH));                              \
            }                                                                                                          \
            me->model.FIELD[at + (uint32_t)(FIRST)] = values[i];                                                       \
        }                                                                                                              \
        return fmi3OK;                                                                                                 \
    }

VALUES(Float64, fmi3Float64, float64, FMU_FLOAT64, FMU_FLOAT64_COUNT, 1, FMU_FLOAT64_PARAMETERS, 0, FMU_FLOAT64_LOW[at],
       FMU_FLOAT64_HIGH[at])
VALUES(Int32, fmi3Int32, int32, FMU_INT32, FMU_INT32_COUNT, 0, 0, FMU_INT32_INPUTS, FMU_INT32_LOW[at],
       FMU_INT32_HIGH[at])
VALUES(Int64, fmi3Int64, int64, FMU_INT64, FMU_INT64_COUNT, 0, 0, 0, 0.0, 0.0)
VALUES(UInt64, fmi3UInt64, uint64, FMU_UINT64, FMU_UINT64_COUNT, 0, FMU_UINT64_PARAMETERS, 0, 0.0,
       18446744073709551615.0)
VALUES(Boolean, fmi3Boolean, boolean, FMU_BOOLEAN, FMU_BOOLEAN_COUNT, 0, 0, FMU_BOOLEAN_INPUTS, 0.0, 1.0)

/* -- state --------------------------------------------------------------------------------------------------------- */

FMI3_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    const instance_t *me = instance;
    if (*state == NULL) {
        *state = malloc(sizeof me->model);
    }
    if (*state == NULL) {
        return refuse(me, "no memory for the state");
    }
    memcpy(*state, &me->model, sizeof me->model);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    instance_t *me = instance;
    memcpy(&me->model, state, sizeof me->model);
    fmu_restored(&me->model);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    (void)instance, (void)state;
    *size = sizeof(fmu_model);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size < sizeof(fmu_model)) {
        return refuse(instance, "the state needs more bytes");
    }
    memcpy(bytes, state, sizeof(fmu_model));
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                               fmi3FMUState *state) {
    if (size != sizeof(fmu_model)) {
        return refuse(instance, "the state is one of another FMU");
    }
    if (*state == NULL) {
        *state = malloc(size);
    }
    if (*state == NULL) {
        return refuse(instance, "no memory for the state");
    }
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* -- what there is none of ----------------------------------------------------------------------------------------- */

/* Callers pass more arguments than these name; none of them is looked at, which C's calling conventions allow. */
#define NONE(NAME)                                                                                                     \
    FMI3_EXPORT fmi3Status NAME(fmi3Instance instance);                                                                \
    FMI3_EXPORT fmi3Status NAME(fmi3Instance instance) {                                                               \
        return refuse(instance, #NAME ": there is none in this FMU");                                                  \
    }
#define NO_VALUES(TYPE) NONE(fmi3Get##TYPE) NONE(fmi3Set##TYPE)

NO_VALUES(Float32)
NO_VALUES(Int8)
NO_VALUES(UInt8)
NO_VALUES(Int16)
NO_VALUES(UInt16)
NO_VALUES(UInt32)
NO_VALUES(String)
NO_VALUES(Binary)
NO_VALUES(Clock)
NO_VALUES(IntervalDecimal)
NO_VALUES(IntervalFraction)
NO_VALUES(ShiftDecimal)
NO_VALUES(ShiftFraction)
NONE(fmi3EnterEventMode)
NONE(fmi3GetNumberOfVariableDependencies)
NONE(fmi3GetVariableDependencies)
NONE(fmi3GetDirectionalDerivative)
NONE(fmi3GetAdjointDerivative)
NONE(fmi3EnterConfigurationMode)
NONE(fmi3ExitConfigurationMode)
NONE(fmi3EvaluateDiscreteStates)
NONE(fmi3UpdateDiscreteStates)
NONE(fmi3EnterStepMode)
NONE(fmi3GetOutputDerivatives)
NONE(fmi3ActivateModelPartition)
NONE(fmi3EnterContinuousTimeMode)
NONE(fmi3CompletedIntegratorStep)
NONE(fmi3SetTime)
NONE(fmi3SetContinuousStates)
NONE(fmi3GetContinuousStateDerivatives)
NONE(fmi3GetEventIndicators)
NONE(fmi3GetContinuousStates)
NONE(fmi3GetNominalsOfContinuousStates)
NONE(fmi3GetNumberOfEventIndicators)
NONE(fmi3GetNumberOfContinuousStates)

FMI3_EXPORT fmi3Instance fmi3InstantiateModelExchange(void) {
    return NULL;
}

FMI3_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(void) {
    return NULL;
}
