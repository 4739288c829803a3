/* What the chip and its board do for the controller: port.c calls it each tick, main.c at the start. A test of port.c
 * has functions of its own instead.
 */
#ifndef TERRAPIN_HARDWARE_H
#define TERRAPIN_HARDWARE_H

#include "can.h"
#include "clock.h"
#include "terrapin.h"
#include "update.h"
#include "usart.h"

struct terrapin_store;

/* What only the hardware knows: filled at the start, and by hardware_sense where it changes. */
typedef struct {
    bool clock_fallback;
    bool adc_silent;
    bool imu_absent;      /* fitted, and says nothing good */
    bool no_ground_wheel; /* the board has no encoder for it */
    bool stopped;         /* STOP_ALL held when the chip was reset */
    bool watchdog_absent;
    bool bridge_break;
    bool brown_out;
    bool brown_out_unset;
    uint8_t reset_cause;
    uint8_t board;
    uint8_t slot;
    uint8_t node; /* as the boot loader's records say; 0 without a boot loader */
    uint32_t unique;
    const uint32_t *link_key; /* four words beside the boot loader; NULL: none */
    uint32_t link_generation; /* of the key */
    uint32_t start;           /* number of this start, by the chip's generator of random numbers */
    uint32_t core_hz;
} hardware_facts;

/* ---- each tick, for port.c */

/* Sample: codes, counts and the emergency stop into *inputs; *facts as they are now. */
void hardware_sense(hardware_facts *facts, terrapin_inputs *inputs);
/* The bridge: duty when on, off otherwise. */
void hardware_drive(const hardware_facts *facts, int16_t duty_q15, bool on);
/* What follows may take longer than the watchdog allows: an erase, a long read (true); or no longer. */
void hardware_flash_work(bool begins);
/* This start is a good one, and the bridge is off: the boot loader, where there is one, may count on it. Called once.
 */
void hardware_healthy(void);
/* Another node number, from the next reset on; the bridge is off. False when the flash refuses. */
bool hardware_store_node(uint8_t node);
/* STOP_ALL holds, or no more: known after a reset that leaves the supply on. */
void hardware_keep_stop(bool stopped);
/* A host asked for it (UPDATE_RESET): what waits on bus and line leaves, then the chip is reset; with `stay` the boot
 * loader remains. */
void hardware_reset(can *bus, usart *line, bool stay);
/* A tick is done: the watchdog may be fed. `lit` is for the LED. */
void hardware_alive(bool lit);
/* Cycles of the core, and those at the last tick's beginning; 0 where nothing counts them. */
uint32_t hardware_cycles(void);
uint32_t hardware_tick_cycles(void);
/* Bytes of stack that were ever used. */
uint32_t hardware_stack_used(void);

/* The board's parameters: their number, and one of them. */
typedef struct {
    uint16_t index;
    int32_t value;
} hardware_parameter;
extern const hardware_parameter hardware_parameters[];
extern const uint32_t hardware_parameter_count;

/* ---- the start, for main.c */

/* Pins, motor and sensors. */
void hardware_open(const clocks *speed);
/* What is known now, after hardware_update; `flags` being RCC->CSR as the reset left it. The watchdog runs from here
 * on, with time for an erase. */
hardware_facts hardware_look(const clocks *speed, uint32_t flags);
/* NULL when the flash cannot hold parameters. */
struct terrapin_store *hardware_store(void);
/* NULL when the image stands alone, without a boot loader. */
terrapin_update *hardware_update(void);
/* The tick, and the watchdog with no more time than it needs. */
void hardware_start(uint32_t core_hz);
/* Ticks since then. */
uint32_t hardware_ticks(void);

#endif
