/* The bxCAN driver against a chip made of memory: what leaves first, what is kept, what is told of the bus. */
#include "unity.h"

#include "../../firmware/ports/stm32f405/can.c"
#include "fake_can.h"

static fake_can chip;
static can bus;
static const terrapin_filter filters[3] = {{0x080U, 0x7F8U}, {0x0A0U, 0x7F8U}, {0x100U, 0x7F8U}};

static void poll(void) {
    can_poll(&bus);
    fake_settle(&chip);
}

static terrapin_frame frame_of(uint16_t id, uint8_t mark) {
    return (terrapin_frame){.id = id, .length = 8, .data = {mark, 2, 3, 4, 5, 6, 7, 8}};
}

static bool send(uint16_t id, uint8_t mark, can_policy policy) {
    const terrapin_frame frame = frame_of(id, mark);
    return can_send(&bus, &frame, policy);
}

/* The next frame on a bus that is ours alone: identifier, and the mark it carries. */
static uint16_t leave(uint8_t *mark) {
    const int box = fake_first(&chip);
    if (box < 0) {
        return 0xFFFFU;
    }
    *mark = (uint8_t)chip.r.tx[box].DLR;
    const uint16_t id = fake_sent(&chip, box);
    can_poll(&bus);
    fake_settle(&chip);
    return id;
}

void setUp(void) {
    fake_open(&chip);
    TEST_ASSERT_TRUE(can_open(&bus, &chip.r, can_timing(42000000U, 500000U), filters, 3U));
    chip.r.MSR = 0U;
    poll();
    TEST_ASSERT_EQUAL(CAN_RUNNING, bus.phase);
    TEST_ASSERT_EQUAL_HEX32(can_timing(42000000U, 500000U), chip.r.BTR);
    TEST_ASSERT_EQUAL_HEX32(BIT(6), chip.r.MCR);
    TEST_ASSERT_EQUAL_HEX32(BIT(1), chip.r.IER);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0U, chip.r.FMR | chip.r.FM1R | chip.r.FS1R | chip.r.FFA1R,
                                    "masks, 16 bits, FIFO 0");
    TEST_ASSERT_EQUAL_HEX32(3U, chip.r.FA1R);
}

void tearDown(void) {}

static void check_timing(uint32_t apb_hz, uint32_t bit_rate) {
    const uint32_t btr = can_timing(apb_hz, bit_rate);
    TEST_ASSERT_NOT_EQUAL(0U, btr);
    const uint32_t prescaler = (btr & 0x3FFU) + 1U;
    const uint32_t segment1 = ((btr >> 16U) & 0xFU) + 1U;
    const uint32_t segment2 = ((btr >> 20U) & 0x7U) + 1U;
    const uint32_t quanta = 1U + segment1 + segment2;
    TEST_ASSERT_EQUAL_UINT32(apb_hz, prescaler * quanta * bit_rate);
    TEST_ASSERT_GREATER_OR_EQUAL(800U, 1000U * (1U + segment1) / quanta); /* sampled at 80 % or later */
    TEST_ASSERT_LESS_OR_EQUAL(889U, 1000U * (1U + segment1) / quanta);
}

static void test_timing(void) {
    static const uint32_t clocks[] = {42000000U, 16000000U, 168000000U};
    static const uint32_t rates[] = {125000U, 250000U, 500000U, 1000000U};
    for (size_t i = 0; i < 3U; i++) {
        for (size_t k = 0; k < 4U; k++) {
            check_timing(clocks[i], rates[k]);
        }
    }
    TEST_ASSERT_EQUAL_UINT32(0U, can_timing(16000000U, 333333U));
}

static void test_absent_chip_is_said_and_harmless(void) {
    memset(&chip, 0, sizeof chip);
    TEST_ASSERT_FALSE(can_open(&bus, &chip.r, can_timing(42000000U, 500000U), filters, 3U));
    TEST_ASSERT_EQUAL(CAN_ABSENT, bus.phase);
    TEST_ASSERT_FALSE(send(0x180U, 1U, CAN_KEEP));
    TEST_ASSERT_TRUE(can_idle(&bus));
    can_poll(&bus);
    can_receive_interrupt(&bus);
    terrapin_frame frame;
    TEST_ASSERT_FALSE(can_take(&bus, &frame));
    TEST_ASSERT_FALSE(can_open(&bus, &chip.r, 0U, filters, 3U));
    TEST_ASSERT_FALSE(can_open(&bus, &chip.r, 1U, filters, CAN_FILTER_MAX + 1U));
}

static void test_bus_that_is_never_quiet_leaves_it_starting(void) {
    fake_open(&chip);
    TEST_ASSERT_TRUE(can_open(&bus, &chip.r, can_timing(42000000U, 500000U), filters, 3U));
    for (int i = 0; i < 50; i++) {
        can_poll(&bus);
    }
    TEST_ASSERT_EQUAL(CAN_STARTING, bus.phase);
    TEST_ASSERT_EQUAL_UINT32(50U, bus.starting);
}

/* What the chip's filters (RM0090, 32.7.4) let through: 16-bit mask mode, data frames with 11-bit identifiers. */
static bool passes(uint16_t id) {
    for (uint32_t bank = 0; bank < 28U; bank++) {
        const uint32_t words[2] = {chip.r.filter[bank].R1, chip.r.filter[bank].R2};
        for (uint32_t i = 0; ((chip.r.FA1R >> bank) & 1U) && (i < 2U); i++) {
            const uint32_t received = (uint32_t)id << 5U;
            if (((received ^ words[i]) & (words[i] >> 16U)) == 0U) {
                return true;
            }
        }
    }
    return false;
}

static void test_filters(void) {
    for (uint16_t id = 0; id < 0x800U; id++) {
        const bool ours = ((id & 0x7F8U) == 0x080U) || ((id & 0x7F8U) == 0x0A0U) || ((id & 0x7F8U) == 0x100U);
        TEST_ASSERT_EQUAL(ours, passes(id));
    }
    TEST_ASSERT_EQUAL_HEX32(0U, chip.r.FMR & CAN_FMR_FINIT);
    TEST_ASSERT_EQUAL_HEX32(BIT(3) | BIT(4), (chip.r.filter[0].R1 >> 16U) & 0x1FU); /* neither extended nor remote */
}

static void test_receives_all_bytes(void) {
    const terrapin_frame sent = {.id = 0x0A5U, .length = 8, .data = {1, 2, 3, 4, 5, 6, 7, 255}};
    terrapin_frame got = {0};
    fake_receive(&chip, &bus, &sent);
    TEST_ASSERT_EQUAL_HEX32(CAN_RF0R_RFOM | CAN_RF0R_FOVR, chip.r.RF0R);
    TEST_ASSERT_TRUE(can_take(&bus, &got));
    TEST_ASSERT_EQUAL_HEX16(sent.id, got.id);
    TEST_ASSERT_EQUAL_UINT8(sent.length, got.length);
    TEST_ASSERT_EQUAL_MEMORY(sent.data, got.data, sizeof sent.data);
    TEST_ASSERT_FALSE(can_take(&bus, &got));
}

static void test_receive_queue_is_bounded_and_counts(void) {
    for (uint32_t i = 0; i < (3U * CAN_IN_SIZE); i++) {
        const terrapin_frame frame = frame_of(0x080U, (uint8_t)i);
        fake_receive(&chip, &bus, &frame);
    }
    TEST_ASSERT_EQUAL_UINT32(2U * CAN_IN_SIZE, bus.in_lost);
    terrapin_frame got = {0};
    for (uint32_t i = 0; i < CAN_IN_SIZE; i++) {
        TEST_ASSERT_TRUE(can_take(&bus, &got));
        TEST_ASSERT_EQUAL_UINT8(i, got.data[0]); /* the oldest are kept, in order */
    }
    TEST_ASSERT_FALSE(can_take(&bus, &got));
    chip.r.RF0R = 0U;
    can_receive_interrupt(&bus); /* nothing there */
    TEST_ASSERT_FALSE(can_take(&bus, &got));
    chip.r.RF0R = CAN_RF0R_FOVR | 3U; /* the chip itself lost one */
    can_receive_interrupt(&bus);
    TEST_ASSERT_EQUAL_UINT32((2U * CAN_IN_SIZE) + 1U, bus.in_lost);
    TEST_ASSERT_TRUE(can_take(&bus, &got));
    chip.r.rx[0].IR = (0x80U << CAN_IR_STID) | CAN_IR_RTR;
    chip.r.RF0R = 1U;
    can_receive_interrupt(&bus);
    TEST_ASSERT_FALSE(can_take(&bus, &got));
}

static void test_leaves_by_priority(void) {
    static const uint16_t order[] = {0x187U, 0x190U, 0x181U, 0x1A0U, 0x180U, 0x193U, 0x085U};
    static const uint16_t sorted[] = {0x085U, 0x180U, 0x181U, 0x187U, 0x190U, 0x193U, 0x1A0U};
    for (size_t i = 0; i < 7U; i++) {
        TEST_ASSERT_TRUE(send(order[i], 0U, CAN_KEEP));
    }
    poll();
    uint8_t mark = 0;
    for (size_t i = 0; i < 7U; i++) {
        TEST_ASSERT_EQUAL_HEX16(sorted[i], leave(&mark));
    }
    TEST_ASSERT_EQUAL_HEX16(0xFFFFU, leave(&mark));
    TEST_ASSERT_EQUAL_UINT32(0U, bus.out_lost);
}

static void test_a_late_first_frame_takes_a_mailbox_back(void) {
    for (uint16_t id = 0x1A0U; id < 0x1A3U; id++) {
        (void)send(id, 0U, CAN_KEEP);
    }
    poll();
    TEST_ASSERT_TRUE(chip.pending[0] && chip.pending[1] && chip.pending[2]); /* all taken, the bus is busy */
    (void)send(0x180U, 0U, CAN_KEEP);
    poll(); /* asks for the last one back */
    poll(); /* gets it, and puts the first one in */
    uint8_t mark = 0;
    static const uint16_t sorted[] = {0x180U, 0x1A0U, 0x1A1U, 0x1A2U};
    for (size_t i = 0; i < 4U; i++) {
        TEST_ASSERT_EQUAL_HEX16(sorted[i], leave(&mark));
    }
    TEST_ASSERT_EQUAL_UINT32(0U, bus.out_lost);
}

/* Before a reset: what is queued, and what a mailbox still sends, would be cut off. */
static void test_idle_once_the_last_frame_has_left(void) {
    uint8_t mark = 0;
    TEST_ASSERT_TRUE(can_idle(&bus));
    for (uint8_t i = 0; i < 4U; i++) {
        TEST_ASSERT_TRUE(send((uint16_t)(0x1A0U + i), i, CAN_KEEP));
    }
    TEST_ASSERT_FALSE(can_idle(&bus));
    poll();
    for (uint8_t i = 0; i < 4U; i++) {
        TEST_ASSERT_FALSE(can_idle(&bus));
        (void)leave(&mark);
    }
    TEST_ASSERT_TRUE(can_idle(&bus));
}

static void test_one_identifier_keeps_its_order(void) {
    for (uint8_t i = 0; i < 6U; i++) {
        TEST_ASSERT_TRUE(send(0x190U, i, CAN_KEEP));
    }
    (void)send(0x1A0U, 99U, CAN_KEEP);
    poll();
    uint8_t mark = 0;
    uint8_t next = 0;
    for (int i = 0; i < 7; i++) {
        const uint16_t id = leave(&mark);
        if (id == 0x190U) {
            TEST_ASSERT_EQUAL_UINT8(next, mark);
            next++;
        }
    }
    TEST_ASSERT_EQUAL_UINT8(6U, next);
}

static void test_telemetry_that_waits_is_replaced_answers_are_not(void) {
    for (uint8_t i = 0; i < 200U; i++) {
        TEST_ASSERT_TRUE(send(0x180U, i, CAN_REPLACE));
        TEST_ASSERT_TRUE(send(0x181U, i, CAN_REPLACE));
    }
    TEST_ASSERT_EQUAL_UINT8(2U, bus.out_count);
    poll();
    uint8_t mark = 0;
    TEST_ASSERT_EQUAL_HEX16(0x180U, leave(&mark));
    TEST_ASSERT_EQUAL_UINT8(199U, mark);
}

static void test_full_queue_gives_up_the_last(void) {
    for (uint32_t i = 0; i < CAN_OUT_SIZE; i++) {
        TEST_ASSERT_TRUE(send(0x190U, (uint8_t)i, CAN_KEEP));
    }
    TEST_ASSERT_FALSE(send(0x1A0U, 0U, CAN_KEEP));  /* behind all: itself */
    TEST_ASSERT_FALSE(send(0x180U, 77U, CAN_KEEP)); /* before all: the newest of 0x190 */
    TEST_ASSERT_EQUAL_UINT32(2U, bus.out_lost);
    TEST_ASSERT_EQUAL_UINT8(CAN_OUT_SIZE, bus.out_count);
    poll();
    uint8_t mark = 0;
    TEST_ASSERT_EQUAL_HEX16(0x180U, leave(&mark));
    for (uint32_t i = 0; i < (CAN_OUT_SIZE - 1U); i++) {
        TEST_ASSERT_EQUAL_HEX16(0x190U, leave(&mark));
        TEST_ASSERT_EQUAL_UINT8(i, mark);
    }
    TEST_ASSERT_EQUAL_HEX16(0xFFFFU, leave(&mark));
}

static void test_bus_off_is_counted_and_ends(void) {
    TEST_ASSERT_TRUE((chip.r.MCR & CAN_MCR_ABOM) != 0U); /* back by itself, RM0090 32.7.6 */
    for (uint32_t i = 1; i <= 3U; i++) {
        chip.r.ESR = CAN_ESR_BOFF | CAN_ESR_EPVF | (0xFFU << CAN_ESR_TEC);
        poll();
        poll();
        TEST_ASSERT_TRUE(bus.state.bus_off);
        TEST_ASSERT_EQUAL_UINT8(255U, bus.state.transmit_errors);
        TEST_ASSERT_EQUAL_UINT32(i, bus.state.bus_off_count);
        chip.r.ESR = 7U << CAN_ESR_REC;
        poll();
        TEST_ASSERT_FALSE(bus.state.bus_off);
        TEST_ASSERT_EQUAL_UINT8(7U, bus.state.receive_errors);
    }
    uint8_t mark = 0;
    (void)send(0x180U, 5U, CAN_KEEP);
    poll();
    TEST_ASSERT_EQUAL_HEX16(0x180U, leave(&mark)); /* and works as before */
}

static void test_no_acknowledge(void) {
    (void)send(0x180U, 0U, CAN_KEEP);
    poll();
    chip.r.ESR = CAN_ESR_LEC_AK | (24U << CAN_ESR_TEC); /* a few missing ones are no diagnosis yet */
    poll();
    TEST_ASSERT_FALSE(bus.state.no_acknowledge);
    chip.r.ESR = CAN_ESR_LEC_AK | CAN_ESR_EPVF | (128U << CAN_ESR_TEC);
    poll();
    TEST_ASSERT_TRUE(bus.state.no_acknowledge);
    chip.r.ESR = (1U << 4U) | CAN_ESR_EPVF | (128U << CAN_ESR_TEC); /* a stuff error takes nothing back */
    poll();
    TEST_ASSERT_TRUE(bus.state.no_acknowledge);
    chip.r.ESR = 127U << CAN_ESR_TEC;
    uint8_t mark = 0;
    TEST_ASSERT_EQUAL_HEX16(0x180U, leave(&mark)); /* somebody took it */
    TEST_ASSERT_FALSE(bus.state.no_acknowledge);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_timing);
    RUN_TEST(test_absent_chip_is_said_and_harmless);
    RUN_TEST(test_bus_that_is_never_quiet_leaves_it_starting);
    RUN_TEST(test_filters);
    RUN_TEST(test_receives_all_bytes);
    RUN_TEST(test_receive_queue_is_bounded_and_counts);
    RUN_TEST(test_leaves_by_priority);
    RUN_TEST(test_a_late_first_frame_takes_a_mailbox_back);
    RUN_TEST(test_idle_once_the_last_frame_has_left);
    RUN_TEST(test_one_identifier_keeps_its_order);
    RUN_TEST(test_telemetry_that_waits_is_replaced_answers_are_not);
    RUN_TEST(test_full_queue_gives_up_the_last);
    RUN_TEST(test_bus_off_is_counted_and_ends);
    RUN_TEST(test_no_acknowledge);
    return UNITY_END();
}
