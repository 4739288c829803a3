#include "flash_emulated.h"

#include <string.h>

#define ERASED 0xFFU
#define KB     1024U

const uint32_t terrapin_flash_f405_sectors[TERRAPIN_FLASH_F405_SECTORS] = {
    16U * KB,  16U * KB,  16U * KB,  16U * KB,  64U * KB,  128U * KB,
    128U * KB, 128U * KB, 128U * KB, 128U * KB, 128U * KB, 128U * KB,
};

/* Data sheet DS8626 (STM32F405xx), flash memory programming with 32-bit parallelism, typical and maximum. */
#define WRITE_US         16U
#define WRITE_LONGEST_US 100U

static uint32_t erase_us(uint32_t size) {
    return (size <= (16U * KB)) ? 250000U : ((size <= (64U * KB)) ? 550000U : 1000000U);
}

/* Marsaglia's xorshift. */
static uint8_t noise(terrapin_flash_emulated *memory) {
    uint32_t x = memory->random;
    x ^= x << 13U;
    x ^= x >> 17U;
    x ^= x << 5U;
    memory->random = x;
    return (uint8_t)(x >> 11U);
}

static bool refuse(terrapin_flash_emulated *memory) {
    memory->misuse++;
    return false;
}

static bool inside(const terrapin_flash_emulated *memory, uint32_t offset, uint32_t size) {
    return (offset <= memory->size) && (size <= (memory->size - offset));
}

/* The bytes become `target` (erased when NULL), or what a cut leaves of that. False when power fails here. */
static bool operate(terrapin_flash_emulated *memory, uint32_t offset, const uint8_t *target, uint32_t size) {
    const bool cut = memory->operations == memory->cut_at;
    memory->operations++;
    if (!cut && (target == NULL)) {
        (void)memset(&memory->bytes[offset], (int)ERASED, size);
        return true;
    }
    for (uint32_t i = 0U; i < size; i++) {
        uint8_t *byte = &memory->bytes[offset + i];
        const uint8_t before = *byte;
        const uint8_t after = (target == NULL) ? ERASED : (uint8_t)(before & target[i]);
        *byte = after;
        if (cut) {
            const uint8_t mask = noise(memory);
            switch (memory->cut) {
            case TERRAPIN_FLASH_CUT_BEFORE:
                *byte = before;
                break;
            case TERRAPIN_FLASH_CUT_TORN:
                *byte = (uint8_t)((before & mask) | (after & (uint8_t)~mask));
                break;
            case TERRAPIN_FLASH_CUT_PART:
                *byte = (i < (size / 2U)) ? after : before;
                break;
            case TERRAPIN_FLASH_CUT_NOISE:
                *byte = mask;
                break;
            case TERRAPIN_FLASH_CUT_AFTER:
            default:
                break;
            }
        }
    }
    memory->off = cut;
    return !cut;
}

static bool erase(void *context, terrapin_flash_area area) {
    terrapin_flash_emulated *memory = context;
    if (memory->off) {
        return false;
    }
    uint32_t start = 0U;
    uint32_t erased = 0U;
    bool begins = false;
    if (!inside(memory, area.offset, area.size) || (area.size == 0U)) {
        return refuse(memory);
    }
    for (uint32_t i = 0U; i < memory->sector_count; i++) { /* whole sectors, or nothing is touched */
        begins = begins || (start == area.offset);
        erased += (begins && (start < (area.offset + area.size))) ? memory->sectors[i] : 0U;
        start += memory->sectors[i];
    }
    if (!begins || (erased != area.size)) {
        return refuse(memory);
    }
    start = 0U;
    for (uint32_t i = 0U; i < memory->sector_count; i++) {
        const uint32_t size = memory->sectors[i];
        if ((start >= area.offset) && (start < (area.offset + area.size))) {
            memory->busy_us += erase_us(size);
            memory->busy_longest_us += (uint64_t)erase_us(size) * 2U;
            if (!operate(memory, start, NULL, size)) {
                return false;
            }
        }
        start += size;
    }
    return true;
}

static bool write(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    terrapin_flash_emulated *memory = context;
    if (memory->off) {
        return false;
    }
    if (!inside(memory, offset, size) || ((offset % memory->write_size) != 0U) || ((size % memory->write_size) != 0U)) {
        return refuse(memory);
    }
    for (uint32_t i = 0U; i < size; i++) {
        if (memory->bytes[offset + i] != ERASED) {
            return refuse(memory);
        }
    }
    for (uint32_t done = 0U; done < size; done += memory->write_size) {
        const uint32_t words = (memory->write_size + 3U) / 4U;
        memory->busy_us += (uint64_t)words * WRITE_US;
        memory->busy_longest_us += (uint64_t)words * WRITE_LONGEST_US;
        if (!operate(memory, offset + done, &bytes[done], memory->write_size)) {
            return false;
        }
    }
    return true;
}

static bool read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    terrapin_flash_emulated *memory = context;
    if (memory->off) {
        return false;
    }
    if (!inside(memory, offset, size)) {
        return refuse(memory);
    }
    (void)memcpy(bytes, &memory->bytes[offset], size);
    return true;
}

void terrapin_flash_emulated_init(terrapin_flash_emulated *memory, uint8_t *bytes, const uint32_t *sectors,
                                  uint32_t sector_count, uint32_t write_size) {
    (void)memset(memory, 0, sizeof *memory);
    memory->bytes = bytes;
    memory->sectors = sectors;
    memory->sector_count = sector_count;
    for (uint32_t i = 0U; i < sector_count; i++) {
        memory->size += sectors[i];
    }
    memory->write_size = write_size;
    memory->cut_at = TERRAPIN_FLASH_EMULATED_NEVER;
    memory->random = 0x2545F491U;
}

terrapin_flash terrapin_flash_emulated_driver(terrapin_flash_emulated *memory) {
    const terrapin_flash driver = {
        .context = memory, .write_size = memory->write_size, .erase = erase, .write = write, .read = read};
    return driver;
}

void terrapin_flash_emulated_power_on(terrapin_flash_emulated *memory) {
    memory->off = false;
    memory->cut_at = TERRAPIN_FLASH_EMULATED_NEVER;
}
