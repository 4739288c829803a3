#include "faults.h"

#include <stddef.h>

const hil_fault *hil_fault_active(const hil_faults *faults, int kind, int channel, double time) {
    for (int i = 0; i < faults->count; i++) {
        const hil_fault *fault = &faults->fault[i];
        if (fault->kind == kind && (channel < 0 || fault->channel == channel) && time >= fault->begin &&
            time < fault->end) {
            return fault;
        }
    }
    return NULL;
}
