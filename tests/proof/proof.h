/* What every proof begins with: values of which nothing is known, and the core's assertions as obligations. */
#ifndef PROOF_H
#define PROOF_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define TERRAPIN_ASSERT(condition) __CPROVER_assert((condition), #condition)
#define PROVE(condition)           __CPROVER_assert((condition), #condition)
#define ASSUME(condition)          __CPROVER_assume(condition)

/* Whatever fills it. */
#define ANYTHING(object) __CPROVER_havoc_object(&(object))

bool nondet_bool(void);
uint8_t nondet_byte(void);
uint32_t nondet_word(void);
int32_t nondet_int(void);

#endif
