/* What a fuzz target claims: abort() is a finding in every build, where assert() may be switched off. */
#ifndef TERRAPIN_FUZZ_CHECK_H
#define TERRAPIN_FUZZ_CHECK_H

#include <stdlib.h>

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

#endif
