/* What an image of the STM32F405 begins and ends with: memory, guard and vectors after a reset, what a fault leaves
 * behind, a word that may not be there, the jump to another image; and the controller's own start and its sleep. On
 * registers made of memory, with a stack of the test's own; the processor's instructions are the test's. */
#define _DEFAULT_SOURCE

#include <setjmp.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "unity.h"

#include "registers.h"

static void hardware_takes(volatile uint32_t *address, uint32_t value);
#define TERRAPIN_PUT(reg, value) hardware_takes(&(reg), (value))

static rcc_registers rcc;
static pwr_registers pwr;
static flash_registers flash_chip;
static scb_registers scb;
static mpu_registers mpu;
static systick_registers systick;
static usart_registers usart1;
static can_registers can1;
static reg32 enabled[4], disabled[4], forgotten[4]; /* one more than the chip has */
#undef RCC
#undef PWR
#undef FLASH
#undef SCB
#undef MPU
#undef SYSTICK
#undef USART1
#undef CAN1
#undef NVIC_ISER
#undef NVIC_ICER
#undef NVIC_ICPR
#define RCC            (&rcc)
#define PWR            (&pwr)
#define FLASH          (&flash_chip)
#define SCB            (&scb)
#define MPU            (&mpu)
#define SYSTICK        (&systick)
#define USART1         (&usart1)
#define CAN1           (&can1)
#define NVIC_ISER      enabled
#define NVIC_ICER      disabled
#define NVIC_ICPR      forgotten
#define TERRAPIN_BOARD "terrapin_board.h"

/* ---- what the linker script lays out */

#define STACK_WORDS 128U
extern uint32_t stack_memory[STACK_WORDS], data_in_flash[4], data_in_ram[5], zeroed[5];
uint32_t stack_memory[STACK_WORDS], data_in_flash[4], data_in_ram[5], zeroed[5];
__asm__(".globl image_stack, image_stack_end, image_data_load, image_data, image_data_end, image_bss, image_bss_end\n"
        ".set image_stack, stack_memory\n"
        ".set image_stack_end, stack_memory + 512\n"
        ".set image_data_load, data_in_flash\n"
        ".set image_data, data_in_ram\n"
        ".set image_data_end, data_in_ram + 16\n"
        ".set image_bss, zeroed\n"
        ".set image_bss_end, zeroed + 16\n");
_Static_assert(sizeof stack_memory == 512U, "as above");

_Noreturn void begun(void);
#define application begun /* the controller's stands below, and is started by itself */
#include "../../firmware/ports/stm32f405/processor.c"
#define weak        unused /* all of them are an image's own here */
#define alias(name) unused
#include "../../firmware/ports/stm32f405/startup.c"
#undef weak
#undef alias
#undef application
_Noreturn void application(void);
#include "../../firmware/ports/stm32f405/main.c"

/* ---- the processor */

static char done[256];
static jmp_buf away;
static bool masked;
static uintptr_t pointer_now;
static uint32_t missing_at;                       /* an address that nothing answers at */
static uint32_t *const frame = &stack_memory[64]; /* of the fault that it causes: 8 words */
static uint32_t begun_stack, begun_entry;
static uint32_t slept;

static void note(const char *what) {
    (void)snprintf(&done[strlen(done)], sizeof done - strlen(done), "%s ", what);
}

static void hardware_takes(volatile uint32_t *address, uint32_t value) {
    TEST_ASSERT_EQUAL_PTR(&scb.AIRCR, address);
    *address = value;
    note("reset");
    longjmp(away, 1);
}
void interrupts_off(void) {
    masked = true;
    note("off");
}
void interrupts_on(void) {
    masked = false;
    note("on");
}
void writes_end(void) {
    note("written");
}
void writes_take_effect(void) {
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(MPU_CTRL_ENABLE | MPU_CTRL_PRIVDEFENA, mpu.CTRL, "the guard stands already");
    note("guarded");
}
void sleep_until_interrupt(void) {
    TEST_ASSERT_TRUE_MESSAGE(masked, "what comes between the last look and the sleep would be slept over");
    slept++;
}
uintptr_t stack_pointer(void) {
    return pointer_now;
}
uint32_t read_narrow(uint32_t address) {
    if (address == missing_at) {
        scb.CFSR = SCB_CFSR_PRECISE | BIT(15);
        fault_seen(frame);
        return 0xBADBADU;
    }
    return address + 1U;
}
void begin_at(uint32_t stack, uint32_t entry) {
    begun_stack = stack;
    begun_entry = entry;
    note("begin");
    longjmp(away, 2);
}
_Noreturn void begun(void) {
    note("application");
    longjmp(away, 3);
}
void fault(void) {}
void systick_interrupt(void) {}
void emergency_stop(void) {
    note("stop");
}

static retained_reason kept_reason;
static uint32_t kept_address, kept_status;
retained_memory retained;
void retained_note(retained_memory *memory, retained_reason reason, uint32_t address, uint32_t status) {
    TEST_ASSERT_EQUAL_PTR(&retained, memory);
    kept_reason = reason;
    kept_address = address;
    kept_status = status;
    note("note");
}

/* ---- what the controller's start asks of the other parts */

static hardware_facts found;
static clocks at_speed = {
    .result = CLOCK_GOOD, .core_hz = 168000000U, .apb1_hz = 42000000U, .apb2_hz = 84000000U, .tim_hz = 168000000U};
static terrapin_node node_of_facts;
static terrapin_filter filters_of_facts[TERRAPIN_BLOCK_RECEIVED];
static struct terrapin_store *const a_store = (struct terrapin_store *)&found;
static terrapin_update an_update;
static uint32_t passes, busy_passes, ticks_now, bytes_waiting;

clocks clock_start(rcc_registers *of, flash_registers *flash, pwr_registers *power, uint32_t crystal, uint32_t inside) {
    TEST_ASSERT_TRUE((of == &rcc) && (flash == &flash_chip) && (power == &pwr));
    TEST_ASSERT_EQUAL_UINT32(BOARD_CRYSTAL_HZ, crystal);
    TEST_ASSERT_EQUAL_UINT32(BOARD_INTERNAL_HZ, inside);
    rcc.CSR = 0U; /* whatever a later part does with it */
    note("clock");
    return at_speed;
}
void hardware_open(const clocks *speed) {
    TEST_ASSERT_EQUAL_MEMORY(&at_speed, speed, sizeof at_speed);
    note("hardware");
}
void usart_open(usart *u, usart_registers *registers, uint32_t apb_hz, uint32_t baud) {
    TEST_ASSERT_TRUE((u == &line) && (registers == &usart1));
    TEST_ASSERT_EQUAL_UINT32(84000000U, apb_hz);
    TEST_ASSERT_EQUAL_UINT32(BOARD_BAUD, baud);
    note("line");
}
terrapin_update *hardware_update(void) {
    note("update");
    return &an_update;
}
hardware_facts hardware_look(const clocks *speed, uint32_t flags) {
    TEST_ASSERT_EQUAL_UINT32(168000000U, speed->core_hz);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0x14000000U, flags, "as the reset left them");
    note("look");
    return found;
}
void terrapin_node_init(terrapin_node *of, uint8_t number) {
    TEST_ASSERT_EQUAL(found.node, number);
    *of = node_of_facts;
}
void terrapin_node_filters(const terrapin_node *of, terrapin_filter filters[TERRAPIN_BLOCK_RECEIVED]) {
    TEST_ASSERT_EQUAL_MEMORY(&node_of_facts, of, sizeof node_of_facts);
    (void)memcpy(filters, filters_of_facts, sizeof filters_of_facts);
}
uint32_t can_timing(uint32_t apb_hz, uint32_t bit_rate) {
    TEST_ASSERT_EQUAL_UINT32(42000000U, apb_hz);
    TEST_ASSERT_EQUAL_UINT32(BOARD_CAN_BIT_S, bit_rate);
    return 0xC0FFEEU;
}
bool can_open(can *c, can_registers *registers, uint32_t timing, const terrapin_filter *filters, uint32_t count) {
    TEST_ASSERT_TRUE((c == &bus) && (registers == &can1));
    TEST_ASSERT_EQUAL_HEX32(0xC0FFEEU, timing);
    TEST_ASSERT_EQUAL_UINT32(TERRAPIN_BLOCK_RECEIVED, count);
    TEST_ASSERT_EQUAL_MEMORY(filters_of_facts, filters, sizeof filters_of_facts);
    note("bus");
    return false; /* no chip: the controller runs on its line */
}
struct terrapin_store *hardware_store(void) {
    return a_store;
}
void port_open(port *p, terrapin_state *of, can *on, usart *over, struct terrapin_store *store, terrapin_update *update,
               const hardware_facts *facts) {
    TEST_ASSERT_TRUE((p == &controller) && (of == (terrapin_state *)state) && (on == &bus) && (over == &line));
    TEST_ASSERT_TRUE((store == a_store) && (update == &an_update));
    TEST_ASSERT_EQUAL_MEMORY(&found, facts, sizeof found);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0U, enabled[0] | enabled[1], "no interrupt before there is a port");
    note("port");
}
void hardware_start(uint32_t core_hz) {
    TEST_ASSERT_EQUAL_UINT32(168000000U, core_hz);
    note("start");
}
uint32_t hardware_ticks(void) {
    return ticks_now;
}
bool port_pass(port *p, uint32_t now) {
    TEST_ASSERT_EQUAL_PTR(&controller, p);
    TEST_ASSERT_EQUAL_UINT32(ticks_now, now);
    TEST_ASSERT_FALSE_MESSAGE(masked, "interrupts are on while it works");
    if (passes == 0U) {
        longjmp(away, 4);
    }
    passes--;
    if (busy_passes > 0U) {
        busy_passes--;
        return true;
    }
    return false;
}
uint32_t ring_used(const ring *r) {
    TEST_ASSERT_EQUAL_PTR(&line.in, r);
    return bytes_waiting;
}
void usart_interrupt(usart *u) {
    TEST_ASSERT_EQUAL_PTR(&line, u);
    note("usart");
}
void can_receive_interrupt(can *c) {
    TEST_ASSERT_EQUAL_PTR(&bus, c);
    note("can");
}

void setUp(void) {
    done[0] = '\0';
    masked = false;
    missing_at = 0xDEADU;
    slept = 0U;
    kept_reason = RETAINED_NOTHING;
    kept_address = kept_status = 0U;
    memset(&scb, 0, sizeof scb);
    memset(&mpu, 0xFF, sizeof mpu);
    memset((void *)(uintptr_t)enabled, 0, sizeof enabled);
    memset((void *)(uintptr_t)disabled, 0, sizeof disabled);
    memset((void *)(uintptr_t)forgotten, 0, sizeof forgotten);
    memset(stack_memory, 0, sizeof stack_memory);
    pointer_now = (uintptr_t)&stack_memory[100];
    bytes_waiting = busy_passes = 0U;
    bus.in_head = bus.in_tail = 0U;
    controller.tick = ticks_now = 7U;
}
void tearDown(void) {}

/* ---- start */

static void restart(void) {
    if (setjmp(away) == 0) {
        reset();
    }
}

static void test_memory_is_as_c_expects_it_before_anything_runs(void) {
    for (uint32_t i = 0U; i < 4U; i++) {
        data_in_flash[i] = 100U + i;
    }
    memset(data_in_ram, 0x77, sizeof data_in_ram);
    memset(zeroed, 0x77, sizeof zeroed);
    memset(stack_memory, 0, sizeof stack_memory);
    restart();
    TEST_ASSERT_EQUAL_STRING("off guarded on application ", done);
    TEST_ASSERT_EQUAL_MEMORY(data_in_flash, data_in_ram, sizeof data_in_flash);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0x77777777U, data_in_ram[4], "what stands behind is another's");
    TEST_ASSERT_EACH_EQUAL_HEX32(0U, zeroed, 4);
    TEST_ASSERT_EQUAL_HEX32(0x77777777U, zeroed[4]);
    TEST_ASSERT_EACH_EQUAL_HEX32(STACK_PATTERN, stack_memory, 100);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0U, stack_memory[100], "in use already");
    TEST_ASSERT_EQUAL_HEX32((uint32_t)(uintptr_t)vectors, scb.VTOR);
}

/* Arm DDI 0403, B3.5: region 0, the lowest 32 bytes; the rest as without an MPU. */
static void test_the_lowest_of_the_stack_is_guarded(void) {
    restart();
    TEST_ASSERT_EQUAL_UINT32(0U, mpu.RNR);
    TEST_ASSERT_EQUAL_HEX32((uint32_t)(uintptr_t)stack_memory, mpu.RBAR);
    TEST_ASSERT_EQUAL_HEX32(BIT(28) | (4U << 1U) | BIT(0), mpu.RASR);
    TEST_ASSERT_EQUAL_HEX32(BIT(0) | BIT(2), mpu.CTRL);
}

static void test_every_exception_has_its_handler(void) {
    for (uint32_t i = 0U; i < (sizeof vectors / sizeof vectors[0]); i++) {
        handler wanted = stray;
        if (i == 0U) {
            wanted = (handler)image_stack_end;
        } else if (i == 1U) {
            wanted = reset;
        } else if (i == 2U) {
            wanted = crystal_stopped;
        } else if (i <= 6U) {
            wanted = fault;
        } else if (i == 15U) {
            wanted = systick_interrupt;
        } else if (i == (16U + 20U)) {
            wanted = can1_receive_interrupt;
        } else if (i == (16U + 37U)) {
            wanted = usart1_interrupt;
        } else {
            /* nobody's */
        }
        TEST_ASSERT_TRUE_MESSAGE(vectors[i] == wanted, "RM0090, table 62");
    }
    TEST_ASSERT_EQUAL(98, sizeof vectors / sizeof vectors[0]);
}

/* ---- faults */

static void test_what_nobody_asked_for_puts_the_bridge_off_and_resets(void) {
    scb.ICSR = 0x99U;
    if (setjmp(away) == 0) {
        stray();
    }
    TEST_ASSERT_EQUAL_STRING("stop note off written reset ", done);
    TEST_ASSERT_EQUAL_HEX32(0x05FA0004U, scb.AIRCR);
    TEST_ASSERT_EQUAL(RETAINED_PROCESSOR_FAULT, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0U, kept_address);
    TEST_ASSERT_EQUAL_HEX32(0x99U, kept_status);
    done[0] = '\0';
    if (setjmp(away) == 0) {
        crystal_stopped();
    }
    TEST_ASSERT_EQUAL_STRING("stop note off written reset ", done);
    TEST_ASSERT_EQUAL(RETAINED_CRYSTAL_STOPPED, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0U, kept_status);
    nothing(); /* what an image without a handler of its own has */
}

static void seen(uint32_t *stacked, uint32_t status, uint32_t address) {
    done[0] = '\0';
    scb.CFSR = status;
    scb.MMFAR = address;
    kept_reason = RETAINED_NOTHING;
    if (setjmp(away) == 0) {
        fault_seen(stacked);
    }
    TEST_ASSERT_EQUAL_STRING("stop note off written reset ", done);
    TEST_ASSERT_EQUAL_HEX32(status, kept_status);
}

static void test_a_fault_is_told_by_its_instruction(void) {
    frame[6] = 0x08001234U;
    seen(frame, 0x82U, 0x20000000U);
    TEST_ASSERT_EQUAL(RETAINED_PROCESSOR_FAULT, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0x08001234U, kept_address);
    seen(frame, SCB_CFSR_PRECISE, 0U); /* no probe's */
    TEST_ASSERT_EQUAL(RETAINED_PROCESSOR_FAULT, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0x08001234U, frame[6]);
}

/* 32 bytes; their address counts where the register is said to hold one. */
static void test_a_guard_that_was_hit_is_a_full_stack(void) {
    const uint32_t guard = (uint32_t)(uintptr_t)stack_memory;
    static const struct {
        int32_t at; /* bytes from the guard's begin */
        uint32_t status;
        retained_reason reason;
    } cases[] = {
        {0, 0x82U, RETAINED_STACK_OVERFLOW},   {31, 0x82U, RETAINED_STACK_OVERFLOW},
        {32, 0x82U, RETAINED_PROCESSOR_FAULT}, {-1, 0x82U, RETAINED_PROCESSOR_FAULT},
        {0, 0x02U, RETAINED_PROCESSOR_FAULT},  {0, SCB_CFSR_MMARVALID, RETAINED_STACK_OVERFLOW},
    };
    frame[6] = 0x08001234U;
    for (size_t i = 0U; i < (sizeof cases / sizeof cases[0]); i++) {
        seen(frame, cases[i].status, guard + (uint32_t)cases[i].at);
        TEST_ASSERT_EQUAL(cases[i].reason, kept_reason);
        TEST_ASSERT_EQUAL_HEX32((cases[i].reason == RETAINED_STACK_OVERFLOW) ? 0U : 0x08001234U, kept_address);
    }
    stack_memory[7 + 6] = stack_memory[8 + 6] = 0x08005678U;
    seen(&stack_memory[7], 0x82U, 0U); /* the frame itself */
    TEST_ASSERT_EQUAL(RETAINED_STACK_OVERFLOW, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0U, kept_address);
    seen(&stack_memory[8], 0x82U, 0U);
    TEST_ASSERT_EQUAL(RETAINED_PROCESSOR_FAULT, kept_reason);
    TEST_ASSERT_EQUAL_HEX32(0x08005678U, kept_address);
}

static void test_a_word_that_is_not_there_is_read_in_vain(void) {
    uint32_t value = 5U;
    frame[6] = 0x08000100U;
    if (setjmp(away) != 0) {
        TEST_FAIL_MESSAGE("a probe's fault is no fault");
    }
    TEST_ASSERT_FALSE(probe_read(0xDEADU, &value));
    TEST_ASSERT_EQUAL_UINT32(5U, value);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0x08000102U, frame[6], "on behind the instruction");
    TEST_ASSERT_EQUAL_HEX32(SCB_CFSR_PRECISE | BIT(15), scb.CFSR);
    TEST_ASSERT_EQUAL_STRING("", done);
    TEST_ASSERT_TRUE_MESSAGE(probe_read(0x20000000U, &value), "the next is asked anew");
    TEST_ASSERT_EQUAL_HEX32(0x20000001U, value);
    TEST_ASSERT_FALSE_MESSAGE(probe_failed(frame, SCB_CFSR_PRECISE), "nobody probes any more");
    probing = true; /* a fault of another kind meanwhile */
    TEST_ASSERT_FALSE(probe_failed(frame, 0x82U));
    TEST_ASSERT_FALSE(probe_refused);
    TEST_ASSERT_EQUAL_HEX32(0x08000102U, frame[6]);
    probing = false;
}

static void test_the_stack_that_was_used(void) {
    for (uint32_t i = 0U; i < STACK_WORDS; i++) {
        stack_memory[i] = STACK_PATTERN;
    }
    TEST_ASSERT_EQUAL_UINT32(0U, stack_used());
    stack_memory[STACK_WORDS - 1U] = 1U;
    TEST_ASSERT_EQUAL_UINT32(4U, stack_used());
    stack_memory[50] = 1U;
    TEST_ASSERT_EQUAL_UINT32(4U * (STACK_WORDS - 50U), stack_used());
    stack_memory[8] = 1U;
    TEST_ASSERT_EQUAL_UINT32(480U, stack_used());
    stack_memory[0] = 1U; /* the guard is not read: touching it is a fault */
    TEST_ASSERT_EQUAL_UINT32(480U, stack_used());
}

/* ---- to another image */

static void test_another_image_finds_the_chip_as_after_a_reset(void) {
    uint32_t *const table =
        mmap((void *)(uintptr_t)0x30000000U, 4096U, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_EQUAL_HEX_MESSAGE(0x30000000U, (uintptr_t)table, "where 32 bits name it");
    table[0] = 0x20020000U;
    table[1] = 0x08020401U;
    table[2] = 0xBADU;
    systick.CTRL = 7U;
    if (setjmp(away) == 0) {
        start_image(0x30000000U);
    }
    TEST_ASSERT_EQUAL_STRING("off begin ", done);
    TEST_ASSERT_EQUAL_HEX32(0x20020000U, begun_stack);
    TEST_ASSERT_EQUAL_HEX32(0x08020401U, begun_entry);
    TEST_ASSERT_EQUAL_HEX32(0U, systick.CTRL);
    TEST_ASSERT_EQUAL_HEX32(BIT(25), scb.ICSR);
    for (uint32_t i = 0U; i < 3U; i++) {
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU, disabled[i]);
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU, forgotten[i]);
    }
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0U, disabled[3] | forgotten[3], "82 interrupts are three words");
    TEST_ASSERT_EQUAL_HEX32(0U, mpu.CTRL);
    TEST_ASSERT_EQUAL_HEX32(0x30000000U, scb.VTOR);
    (void)munmap(table, 4096U);
}

/* ---- the controller */

static void runs(uint32_t count) {
    passes = count;
    slept = 0U;
    enabled[0] = enabled[1] = 0U;
    rcc.CSR = 0x14000000U;
    if (setjmp(away) == 0) {
        application();
    }
    TEST_ASSERT_FALSE(masked);
}

static void test_the_controller_is_put_together_in_order(void) {
    found.node = 3U;
    found.unique = 0x1234U;
    node_of_facts.number = 3U;
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_RECEIVED; i++) {
        filters_of_facts[i] = (terrapin_filter){(uint16_t)(i + 1U), 0x7F0U};
    }
    runs(0U);
    TEST_ASSERT_EQUAL_STRING("clock hardware line update look bus port start ", done);
    TEST_ASSERT_EQUAL_HEX32(BIT(20), enabled[0]);
    TEST_ASSERT_EQUAL_HEX32(BIT(5), enabled[1]); /* 37 */
    TEST_ASSERT_EQUAL_HEX32(0U, enabled[2] | enabled[3]);
}

static void test_it_sleeps_when_nothing_waits(void) {
    runs(3U);
    TEST_ASSERT_EQUAL_UINT32(3U, slept);
    busy_passes = 2U;
    runs(3U);
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(1U, slept, "not while there is work");
    controller.tick = ticks_now - 1U; /* a tick came meanwhile, */
    runs(1U);
    TEST_ASSERT_EQUAL_UINT32(0U, slept);
    controller.tick = ticks_now;
    bytes_waiting = 1U; /* a byte, */
    runs(1U);
    TEST_ASSERT_EQUAL_UINT32(0U, slept);
    bytes_waiting = 0U;
    bus.in_head = 1U; /* a frame */
    runs(1U);
    TEST_ASSERT_EQUAL_UINT32(0U, slept);
}

static void test_interrupts_go_to_their_parts(void) {
    usart1_interrupt();
    can1_receive_interrupt();
    TEST_ASSERT_EQUAL_STRING("usart can ", done);
}

static void test_an_image_says_what_it_is_made_for(void) {
    TEST_ASSERT_EQUAL_STRING("terrapin-made", made.name);
    TEST_ASSERT_EQUAL_HEX32((uint32_t)TERRAPIN_ROBOT_IDENTITY, made.made_for & 0xFFFFFFU);
    TEST_ASSERT_EQUAL_UINT32(BOARD_NUMBER, made.made_for >> 24U);
    TEST_ASSERT_EQUAL_UINT32(TERRAPIN_INTERFACE_VERSION, made.interface);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_memory_is_as_c_expects_it_before_anything_runs);
    RUN_TEST(test_the_lowest_of_the_stack_is_guarded);
    RUN_TEST(test_every_exception_has_its_handler);
    RUN_TEST(test_what_nobody_asked_for_puts_the_bridge_off_and_resets);
    RUN_TEST(test_a_fault_is_told_by_its_instruction);
    RUN_TEST(test_a_guard_that_was_hit_is_a_full_stack);
    RUN_TEST(test_a_word_that_is_not_there_is_read_in_vain);
    RUN_TEST(test_the_stack_that_was_used);
    RUN_TEST(test_another_image_finds_the_chip_as_after_a_reset);
    RUN_TEST(test_the_controller_is_put_together_in_order);
    RUN_TEST(test_it_sleeps_when_nothing_waits);
    RUN_TEST(test_interrupts_go_to_their_parts);
    RUN_TEST(test_an_image_says_what_it_is_made_for);
    return UNITY_END();
}
