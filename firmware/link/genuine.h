/* Frames that carry counter and CRC: whether one may be used. Of use to the link layer alone. */
#ifndef TERRAPIN_GENUINE_H
#define TERRAPIN_GENUINE_H

#include "dispatch.h"

/* True when a protected frame may be used; counts it otherwise. `last_counter`: of the last one that was. */
bool link_genuine(terrapin_link *link, const terrapin_frame *frame, uint8_t length, uint8_t *last_counter);

#endif
