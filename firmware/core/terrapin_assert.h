/* TERRAPIN_ASSERT(condition): what must hold here whatever came from outside; if not, the program itself is wrong.
 *
 * It is on where TERRAPIN_ASSERTIONS is defined: in everything that this project builds for a host, tests, sanitizers
 * and fuzzing among it. In an image it is no code at all, so a condition has no side effect. Somebody else's firmware
 * may define the macro as it likes.
 */
#ifndef TERRAPIN_ASSERT_H
#define TERRAPIN_ASSERT_H

#ifndef TERRAPIN_ASSERT
#ifdef TERRAPIN_ASSERTIONS
#include <assert.h>
#define TERRAPIN_ASSERT(condition) assert(condition)
#else
#define TERRAPIN_ASSERT(condition) ((void)0)
#endif
#endif

#endif
