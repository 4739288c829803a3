#include "flash_driver.h"
#include "wait.h"

#define SECTORS     12U
#define TRIES_WRITE 4000U      /* 100 us for a word */
#define TRIES_ERASE 120000000U /* over 4 s at 168 MHz; the processor stands still, so that few tries go by */
#define WORD        4U

uint32_t flash_sector_size(uint32_t sector) {
    if (sector < 4U) {
        return 0x4000U;
    }
    return (sector == 4U) ? 0x10000U : 0x20000U;
}

int32_t flash_sector_at(uint32_t offset) {
    uint32_t start = 0U;
    for (uint32_t sector = 0U; sector < SECTORS; sector++) {
        if (offset == start) {
            return (int32_t)sector;
        }
        start += flash_sector_size(sector);
    }
    return -1;
}

static bool inside(const flash_driver *driver, uint32_t offset, uint32_t size) {
    const terrapin_flash_area *serves = &driver->serves;
    return (offset >= serves->offset) && (size <= serves->size) && ((offset - serves->offset) <= (serves->size - size));
}

static bool unlock(flash_registers *registers, uint32_t tries) {
    if (!wait_for(&registers->SR, FLASH_SR_BSY, 0U, tries)) {
        return false;
    }
    if ((registers->CR & FLASH_CR_LOCK) != 0U) {
        TERRAPIN_PUT(registers->KEYR, FLASH_KEY1);
        TERRAPIN_PUT(registers->KEYR, FLASH_KEY2);
    }
    TERRAPIN_PUT(registers->SR, FLASH_SR_ERRORS | FLASH_SR_EOP); /* of an earlier operation; cleared by writing them */
    return (registers->CR & FLASH_CR_LOCK) == 0U;
}

/* True when the operation ended in time and without an error. The interface is locked again whatever happened. */
static bool finish(flash_registers *registers, uint32_t tries) {
    const bool ended = wait_for(&registers->SR, FLASH_SR_BSY, 0U, tries);
    const bool good = ended && ((registers->SR & FLASH_SR_ERRORS) == 0U);
    TERRAPIN_PUT(registers->CR, FLASH_CR_LOCK);
    return good;
}

static bool erase_sector(flash_driver *driver, uint32_t sector) {
    flash_registers *registers = driver->registers;
    if (!unlock(registers, TRIES_ERASE)) {
        return false;
    }
    TERRAPIN_PUT(registers->CR, FLASH_CR_PSIZE_32 | FLASH_CR_SER | (sector << FLASH_CR_SNB));
    TERRAPIN_PUT(registers->CR, registers->CR | FLASH_CR_STRT);
    const bool good = finish(registers, TRIES_ERASE);
    const uint32_t acr = registers->ACR; /* the caches still hold what was there (RM0090, 3.5.2) */
    const uint32_t off = acr & ~(FLASH_ACR_ICEN | FLASH_ACR_DCEN);
    TERRAPIN_PUT(registers->ACR, off); /* they can be emptied only then */
    TERRAPIN_PUT(registers->ACR, off | FLASH_ACR_ICRST | FLASH_ACR_DCRST);
    TERRAPIN_PUT(registers->ACR, acr);
    return good;
}

static bool erase(void *context, terrapin_flash_area area) {
    flash_driver *driver = context;
    const int32_t first = flash_sector_at(area.offset);
    if ((first < 0) || (area.size == 0U) || !inside(driver, area.offset, area.size)) {
        return false;
    }
    uint32_t end = area.offset;
    uint32_t last = (uint32_t)first;
    while ((end - area.offset) < area.size) { /* inside: there are enough sectors */
        end += flash_sector_size(last);
        last++;
    }
    if ((end - area.offset) != area.size) {
        return false; /* not whole sectors: nothing is erased */
    }
    for (uint32_t sector = (uint32_t)first; sector < last; sector++) {
        if (!erase_sector(driver, sector)) {
            return false;
        }
    }
    return true;
}

static bool write(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    flash_driver *driver = context;
    flash_registers *registers = driver->registers;
    if (((offset % WORD) != 0U) || ((size % WORD) != 0U) || !inside(driver, offset, size)) {
        return false;
    }
    bool good = true;
    for (uint32_t at = 0U; good && (at < size); at += WORD) {
        volatile uint32_t *unit = (volatile uint32_t *)(void *)&driver->memory[offset + at];
        const uint32_t word = (uint32_t)bytes[at] | ((uint32_t)bytes[at + 1U] << 8U) |
                              ((uint32_t)bytes[at + 2U] << 16U) | ((uint32_t)bytes[at + 3U] << 24U);
        good = unlock(registers, TRIES_WRITE);
        if (good) {
            TERRAPIN_PUT(registers->CR, FLASH_CR_PSIZE_32 | FLASH_CR_PG);
            TERRAPIN_PUT(*unit, word);
            good = finish(registers, TRIES_WRITE) && (*unit == word);
        }
    }
    return good;
}

static bool read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    const flash_driver *driver = context;
    if (!inside(driver, offset, size)) {
        return false;
    }
    for (uint32_t i = 0U; i < size; i++) {
        bytes[i] = driver->memory[offset + i];
    }
    return true;
}

terrapin_flash flash_open(flash_driver *driver, flash_registers *registers, uint8_t *memory,
                          terrapin_flash_area serves) {
    driver->registers = registers;
    driver->memory = memory;
    driver->serves = serves;
    const terrapin_flash interface = {
        .context = driver, .write_size = WORD, .erase = erase, .write = write, .read = read};
    return interface;
}
