#include "unique.h"

#include "crc32.h"
#include "processor.h"
#include "registers.h"

uint32_t unique_number(void) {
    uint8_t bytes[12] = {0};
    for (uint32_t i = 0; i < 3U; i++) {
        uint32_t word = 0;
        if (!probe_read(UNIQUE_ID + (4U * i), &word)) {
            return 0U;
        }
        for (uint32_t k = 0; k < 4U; k++) {
            bytes[(4U * i) + k] = (uint8_t)(word >> (8U * k));
        }
    }
    return terrapin_crc32(0U, bytes, sizeof bytes);
}
