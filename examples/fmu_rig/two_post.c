// A rig for FMI 2.0 and 3.0 co-simulation: a beam on two cylinders, strokes in m in, forces in N out.
// `fault` makes it fail from the first step on in which a stroke is larger than `fault_above`; for tests.
#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

enum { FRONT_STROKE, REAR_STROKE, FRONT_FORCE, REAR_FORCE, STIFFNESS, FAULT, FAULT_ABOVE, TIME, VARIABLES };
enum { NONE, CRASH, EXIT, HANG, REFUSE, NOT_A_NUMBER, VARY };
static const double FREQUENCY = 251.0, DAMPING = 0.7, STEP = 2.5e-4;  // of the cylinders' loops; rad/s, 1, s

typedef struct { double value[VARIABLES], position[2], speed[2]; } Rig;

static void measure(Rig *rig) {
    for (int end = 0; end < 2; end++) {
        double x = rig->position[end], other = rig->position[1 - end];
        rig->value[FRONT_FORCE + end] = rig->value[STIFFNESS] * (x + 300.0 * x * x * x - 0.2 * other) + 600.0 * rig->speed[end];
    }
}
static void *instantiate(void) {
    Rig *rig = calloc(1, sizeof *rig);
    rig->value[STIFFNESS] = 4.0e5;
    return rig;
}
static int set(Rig *rig, const unsigned *which, size_t count, const double *values) {
    for (size_t i = 0; i < count; i++) rig->value[which[i]] = values[i];
    return 0;
}
static int get(Rig *rig, const unsigned *which, size_t count, double *values) {
    measure(rig);
    for (size_t i = 0; i < count; i++) values[i] = rig->value[which[i]];
    if (rig->value[FAULT] == NOT_A_NUMBER && fabs(rig->value[FRONT_STROKE]) > rig->value[FAULT_ABOVE]) values[0] = NAN;
    return 0;
}
static int do_step(Rig *rig, double seconds) {
    int fault = fabs(rig->value[FRONT_STROKE]) > rig->value[FAULT_ABOVE] ? (int)rig->value[FAULT] : NONE;
    struct timespec now;
    if (fault == CRASH) *(volatile int *)0 = 0;
    if (fault == EXIT) exit(3);
    while (fault == HANG) {}
    if (fault == REFUSE) return 3;
    for (long i = 0, steps = lround(seconds / STEP); i < steps; i++)
        for (int end = 0; end < 2; end++) {
            double pull = FREQUENCY * FREQUENCY * (rig->value[end] - rig->position[end]);
            rig->speed[end] += STEP * (pull - 2.0 * DAMPING * FREQUENCY * rig->speed[end]);
            rig->position[end] += STEP * rig->speed[end];
        }
    if (fault == VARY && timespec_get(&now, TIME_UTC)) rig->position[0] += 1e-15 * (double)now.tv_nsec;
    return 0;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) { return instantiate(); }
fmi2Status fmi2SetupExperiment(fmi2Component rig, fmi2Boolean d, fmi2Real tolerance, fmi2Real start, fmi2Boolean e, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component rig) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component rig) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component rig) { return fmi2OK; }
void fmi2FreeInstance(fmi2Component rig) { free(rig); }
fmi2Status fmi2SetReal(fmi2Component rig, const unsigned *which, size_t count, const double *values) { return set(rig, which, count, values); }
fmi2Status fmi2GetReal(fmi2Component rig, const unsigned *which, size_t count, double *values) { return get(rig, which, count, values); }
fmi2Status fmi2DoStep(fmi2Component rig, fmi2Real now, fmi2Real seconds, fmi2Boolean no_return) { return do_step(rig, seconds); }

const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference *intermediate, size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) { return instantiate(); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance rig, fmi3Boolean d, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean e, fmi3Float64 stop) { return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance rig) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance rig) { return fmi3OK; }
void fmi3FreeInstance(fmi3Instance rig) { free(rig); }
fmi3Status fmi3SetFloat64(fmi3Instance rig, const unsigned *which, size_t count, const double *values, size_t n) { return set(rig, which, count, values); }
fmi3Status fmi3GetFloat64(fmi3Instance rig, const unsigned *which, size_t count, double *values, size_t n) { return get(rig, which, count, values); }
fmi3Status fmi3DoStep(fmi3Instance rig, fmi3Float64 now, fmi3Float64 seconds, fmi3Boolean no_return, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    *event = *end = *early = 0;
    *last = now + seconds;
    return do_step(rig, seconds);
}
