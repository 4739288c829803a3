/* What boot loader and application share of the update; of no use to others. */
#ifndef TERRAPIN_UPDATE_REQUESTS_H
#define TERRAPIN_UPDATE_REQUESTS_H

#include "update.h"

/* The slot may be written: it is neither the confirmed one nor the one that runs. */
bool update_writable(const terrapin_update *update, const terrapin_record *record, uint8_t slot);
/* The frame is whole and new; counted otherwise. */
bool update_genuine(terrapin_update *update, const terrapin_frame *frame, uint8_t *last_counter);
/* Write UPDATE_STATUS; 1. */
uint32_t update_status(terrapin_update *update, uint8_t request, uint8_t result, terrapin_frame *reply);
/* Serve UPDATE_RESET and UPDATE_QUERY; the number of replies. */
uint32_t update_reset(terrapin_update *update, const terrapin_frame *frame, bool motor_on, terrapin_frame *reply);
uint32_t update_query(terrapin_update *update, const terrapin_frame *frame,
                      terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]);

#endif
