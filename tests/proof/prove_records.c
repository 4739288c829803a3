/* The boot loader's records: any bytes of flash are read within their bounds, and give a record within its ranges; what
 * was encoded is decoded again. The checksum is any function of the bytes. */
#include "proof.h"

#include "records.c"

/* Any checksum, the same for the same bytes: of the last place it was asked about. */
static uint32_t checksum;

uint32_t terrapin_crc32(uint32_t crc, const uint8_t *bytes, uint32_t size) {
    (void)crc;
    PROVE(__CPROVER_r_ok(bytes, size));
    return checksum;
}

int main(void) {
    uint8_t bytes[TERRAPIN_RECORD_SIZE];
    terrapin_record record;
    terrapin_record again;
    uint32_t sequence = 0U;
    checksum = nondet_word();
    ANYTHING(bytes);
    (void)blank(bytes);
    if (decode(bytes, &record, &sequence)) {
        PROVE((record.confirmed <= TERRAPIN_UPDATE_SLOT_B) && (record.candidate <= TERRAPIN_UPDATE_SLOT_B));
        PROVE(record.phase <= TERRAPIN_UPDATE_PHASE_TRIAL);
        uint32_t number = 0U;
        encode(&record, sequence, bytes);
        PROVE(decode(bytes, &again, &number) && (number == sequence));
        PROVE((again.confirmed == record.confirmed) && (again.candidate == record.candidate));
        PROVE((again.phase == record.phase) && (again.security_counter == record.security_counter));
        PROVE((again.version.revision == record.version.revision) && (again.version.build == record.version.build));
    }
    return 0;
}
