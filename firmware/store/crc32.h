/* CRC-32 (ISO-HDLC: that of Ethernet, zip and Python's zlib.crc32). Check value of "123456789": 0xCBF43926. */
#ifndef TERRAPIN_CRC32_H
#define TERRAPIN_CRC32_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* CRC of `length` bytes that follow those whose CRC is `crc` (0 at the start). 16 words of table, two steps a byte. */
uint32_t terrapin_crc32(uint32_t crc, const uint8_t *bytes, size_t length);

#ifdef __cplusplus
}
#endif
#endif
