#include "genuine.h"

#include "terrapin_interface.h"

bool link_genuine(terrapin_link *link, const terrapin_frame *frame, uint8_t length, uint8_t *last_counter) {
    bool good = false;
    if (frame->length != length) {
        link->malformed++;
    } else {
        switch (terrapin_e2e_check(frame, last_counter)) {
        case TERRAPIN_E2E_OK:
            good = true;
            break;
        case TERRAPIN_E2E_REPEATED:
            link->repeated++;
            break;
        case TERRAPIN_E2E_BAD_CRC:
        default:
            link->bad_crc++;
            break;
        }
    }
    return good;
}
