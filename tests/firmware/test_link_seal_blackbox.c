/* A controller with a link key, against somebody who has all its traffic: nothing old, changed or guessed is taken. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "dispatch.h"
#include "sealed_host.h"
#include "state.h"

#define GENERATION 3U
#define RECORDED   64U

static const uint32_t link_key[4] = {0x01020304U, 0x05060708U, 0x090A0B0CU, 0x0D0E0F10U};
static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;
static terrapin_frame reply;
static uint64_t noise;

typedef sealed_host host;

static uint32_t draw(void) { /* xorshift64* */
    noise ^= noise >> 12U;
    noise ^= noise << 25U;
    noise ^= noise >> 27U;
    return (uint32_t)((noise * 0x2545F4914F6CDD1DULL) >> 32U);
}

static void boot(uint32_t start) {
    terrapin_link_init(&link, &state, &inputs);
    terrapin_link_seal(&link, link_key, GENERATION, start);
}

void setUp(void) {
    noise = 88172645463325252ULL;
    boot(1U);
}

void tearDown(void) {}

static terrapin_accept_result give(const terrapin_frame *frame) {
    return terrapin_accept(&link, &state, frame, &inputs, &reply);
}

static void later(uint32_t ms) {
    terrapin_seal_at(&link.seal, link.seal.now_ms + ms);
}

/* True when the frame was taken as a command. */
static bool commands(const terrapin_frame *frame) {
    inputs.command_fresh = false;
    (void)give(frame);
    return inputs.command_fresh;
}

static terrapin_frame session_open(uint32_t number, uint32_t generation) {
    terrapin_frame frame;
    const terrapin_session_open_t message = {.host = number, .generation = generation};
    TEST_ASSERT_TRUE(terrapin_encode_session_open(&message, &frame));
    return frame;
}

static void open_session(host *h, uint32_t number) {
    terrapin_session_t answer;
    const terrapin_frame frame = session_open(number, GENERATION);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&frame));
    TEST_ASSERT_TRUE(terrapin_decode_session(&reply, &answer));
    TEST_ASSERT_EQUAL_UINT32((2U * link.seal.opened) + link.seal.waiting, answer.count);
    sealed_host_opens(h, link_key, number, GENERATION, &answer, link.seal.now_ms);
}

static terrapin_frame sealed(host *h, int32_t request) {
    terrapin_frame frame;
    const terrapin_command_sealed_t message = {.request = request, .setpoint = 1000};
    TEST_ASSERT_TRUE(terrapin_encode_command_sealed(&message, &frame));
    sealed_host_at(h, link.seal.now_ms);
    sealed_host_commands(h, &frame);
    return frame;
}

static terrapin_frame seal_of(host *h, const terrapin_frame *frame) {
    sealed_host_at(h, link.seal.now_ms);
    return sealed_host_seals(h, frame);
}

static terrapin_frame plain_command(int32_t request, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_command_t message = {.request = request, .setpoint = 1000};
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static terrapin_frame write_of(int32_t value, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_parameter_write_t message = {.index = TERRAPIN_PARAMETER_RADIUS, .value = value};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static int32_t radius(void) {
    return terrapin_parameter_values(&state)[TERRAPIN_PARAMETER_RADIUS];
}

/* Nicky Mouha's reference, chaskey12.c: the message of bytes 0 to 15. */
static void test_the_published_vector(void) {
    static const uint32_t key[4] = {0x833D3433U, 0x009F389FU, 0x2398E64FU, 0x417ACF39U};
    static const uint32_t block[4] = {0x03020100U, 0x07060504U, 0x0B0A0908U, 0x0F0E0D0CU};
    static const uint32_t expected[4] = {0x5DD0E2A9U, 0xFB5EAC8CU, 0x633A392EU, 0x500C36F3U};
    uint32_t tag[4];
    terrapin_chaskey(key, block, tag);
    TEST_ASSERT_EQUAL_HEX32_ARRAY(expected, tag, 4);
}

static void test_only_sealed_commands_but_idle_of_anybody(void) {
    host h;
    for (uint32_t counter = 0; counter < 15U; counter++) {
        for (int32_t request = TERRAPIN_REQUEST_CALIBRATE; request <= TERRAPIN_REQUEST_CLEAR; request++) {
            const terrapin_frame frame = plain_command(request, counter);
            TEST_ASSERT_FALSE(commands(&frame));
        }
        const terrapin_frame idle = plain_command(TERRAPIN_REQUEST_IDLE, counter);
        TEST_ASSERT_TRUE(commands(&idle));
    }
    TEST_ASSERT_EQUAL(45U, link.unsealed);
    open_session(&h, 7U);
    const terrapin_frame run = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&run));
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_RUN, inputs.command.request);
    TEST_ASSERT_EQUAL(1000, inputs.command.setpoint);
}

/* All within half a second: it is the order that refuses them, and the tag; each tag is looked at. */
static void test_replayed_reordered_delayed_and_changed_frames(void) {
    host h;
    terrapin_frame recorded[RECORDED];
    uint32_t accepted = 0;
    open_session(&h, 7U);
    for (uint32_t i = 0; i < RECORDED; i++) {
        recorded[i] = sealed(&h, TERRAPIN_REQUEST_RUN);
        later(8U);
        if (i % 2U == 0U) { /* the others are held back: they come late */
            TEST_ASSERT_TRUE(commands(&recorded[i]));
        }
    }
    const terrapin_frame last = sealed(&h, TERRAPIN_REQUEST_RUN);
    link.seal.checks = 0U;
    TEST_ASSERT_TRUE(commands(&last));
    for (uint32_t i = 0; i < 20000U; i++) {
        link.seal.checks = 0U;
        accepted += commands(&recorded[draw() % RECORDED]) ? 1U : 0U;
    }
    TEST_ASSERT_EQUAL(0U, accepted);
    const terrapin_frame next = sealed(&h, TERRAPIN_REQUEST_RUN);
    for (uint32_t bit = 0; bit < 64U; bit++) {
        terrapin_frame flipped = next;
        flipped.data[bit / 8U] ^= (uint8_t)(1U << (bit % 8U));
        link.seal.checks = 0U;
        accepted += commands(&flipped) ? 1U : 0U;
    }
    TEST_ASSERT_EQUAL(0U, accepted);
    link.seal.checks = 0U;
    TEST_ASSERT_TRUE_MESSAGE(commands(&next), "as it is, it is a good one");
}

/* A gateway that lets nothing pass any more but one frame, whose order is right whenever it comes. */
static bool withheld(uint32_t ms, bool write) {
    host h;
    boot(draw());
    later(draw()); /* clocks wrap */
    open_session(&h, 7U);
    const terrapin_frame first = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&first));
    later(50U);
    const int32_t before = radius();
    const terrapin_frame change = write_of(before + 1, 0U);
    const terrapin_frame late = write ? seal_of(&h, &change) : sealed(&h, TERRAPIN_REQUEST_RUN);
    for (uint32_t left = ms; left > 0U;) {
        const uint32_t step = (left > 3600000U) ? 3600000U : left;
        later(step);
        left -= step;
    }
    (void)give(&change);
    return write ? (give(&late) == TERRAPIN_ACCEPT_REPLY) : commands(&late);
}

static void test_a_withheld_frame_is_taken_for_a_second_at_most(void) {
    static const uint32_t after[] = {1001U, 2000U, 3600000U, 86400000U, UINT32_MAX - 50U, UINT32_MAX};
    for (uint32_t kind = 0; kind < 2U; kind++) {
        for (uint32_t ms = 0; ms <= 960U; ms += 20U) {
            TEST_ASSERT_TRUE_MESSAGE(withheld(ms, kind == 1U), "two delays of 0.4 s");
        }
        for (uint32_t ms = 1000U; ms < 8000U; ms++) {
            TEST_ASSERT_FALSE(withheld(ms, kind == 1U));
        }
        for (size_t i = 0; i < sizeof after / sizeof after[0]; i++) {
            TEST_ASSERT_FALSE(withheld(after[i], kind == 1U));
        }
    }
}

static void test_a_clock_may_be_a_little_before_this_one(void) {
    host h;
    open_session(&h, 7U);
    for (uint32_t early = 3U; early <= 5U; early++) { /* the least time is 1, so the first tag may be 3 before */
        later(80U);
        h.time = (link.seal.now_ms / 8U) + early - 1U;
        h.begun_ms = link.seal.now_ms;
        const terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
        TEST_ASSERT_EQUAL(early <= 4U, commands(&frame));
    }
}

/* `gap` ms after the last good tag the host, whose SESSION came `lag` ms late, seals a fresh one. */
static bool after_silence(uint32_t lag, uint32_t gap) {
    host h;
    boot(draw());
    open_session(&h, 7U);
    later(lag);
    h.begun_ms = link.seal.now_ms;
    const terrapin_frame first = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&first));
    later(gap);
    const terrapin_frame second = sealed(&h, TERRAPIN_REQUEST_RUN);
    return commands(&second);
}

static void test_a_session_ends_one_to_two_seconds_after_its_last_good_tag(void) {
    for (uint32_t lag = 0; lag <= 950U; lag += 50U) {
        TEST_ASSERT_TRUE(after_silence(lag, 1000U));
        TEST_ASSERT_FALSE(after_silence(lag, 2000U));
    }
    TEST_ASSERT_TRUE(after_silence(0U, 1967U)); /* the first one's time is 8 ms */
    TEST_ASSERT_FALSE(after_silence(0U, 1968U));
}

static void test_a_session_ends_at_either_place_and_nothing_else(void) {
    static struct {
        terrapin_seal seal;
        uint32_t beside[8]; /* each like a session's begin and time, wherever it would lie */
    } held;
    static const uint32_t ones[8] = {1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U};
    memcpy(held.beside, ones, sizeof ones);
    for (uint32_t place = 0; place < 2U; place++) {
        held.seal.session[place].next = 9U;
    }
    terrapin_seal_at(&held.seal, 5000U);
    TEST_ASSERT_EQUAL_UINT32(0U, held.seal.session[0].next);
    TEST_ASSERT_EQUAL_UINT32(0U, held.seal.session[1].next);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(ones, held.beside, 8);
}

static void test_a_session_without_a_tag_ends_too(void) {
    for (uint32_t ms = 1900U; ms <= 2000U; ms++) {
        host h;
        boot(draw());
        open_session(&h, 7U);
        later(ms);
        const terrapin_frame first = sealed(&h, TERRAPIN_REQUEST_RUN);
        TEST_ASSERT_EQUAL(ms < 1960U, commands(&first));
    }
}

/* Whoever can tell the next challenge has frames sealed today for a session of tomorrow. */
static void test_a_challenge_is_nobodys_to_tell(void) {
    terrapin_session_t answer[2];
    const terrapin_frame ask = session_open(7U, GENERATION);
    for (uint32_t i = 0; i < 2U; i++) {
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&ask));
        TEST_ASSERT_TRUE(terrapin_decode_session(&reply, &answer[i]));
        const uint32_t drawn[4] = {1U, i + 1U, 0U, 0U};
        uint32_t expected[4];
        terrapin_chaskey(link_key, drawn, expected);
        TEST_ASSERT_EQUAL_HEX32(expected[0], answer[i].start);
        later(200U);
    }
    TEST_ASSERT_NOT_EQUAL(answer[0].start, answer[1].start);
    boot(2U);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&ask));
    TEST_ASSERT_TRUE(terrapin_decode_session(&reply, &answer[1]));
    TEST_ASSERT_NOT_EQUAL(answer[0].start, answer[1].start);
}

/* Whose tag was really checked: the limit of checks is lifted, and each is counted. */
static void test_a_million_guessed_tags(void) {
    host h;
    uint32_t accepted = 0;
    uint32_t checked = 0;
    open_session(&h, 7U);
    const terrapin_frame good = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&good));
    for (uint32_t i = 0; checked < 1000000U; i++) {
        terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
        const uint32_t guess = draw();
        h.time = 1U;
        if (memcmp(&guess, &frame.data[4], 4) == 0) {
            continue; /* this one would be right */
        }
        memcpy(&frame.data[4], &guess, 4);
        link.seal.checks = 0U;
        accepted += commands(&frame) ? 1U : 0U;
        checked += link.seal.checks;
    }
    TEST_ASSERT_EQUAL(0U, accepted);
    TEST_ASSERT_GREATER_OR_EQUAL(1000000U, link.unsealed);
}

static void test_at_most_twenty_tags_are_checked_in_a_tenth_of_a_second(void) {
    host h;
    uint32_t checked = 0;
    for (uint32_t tick = 0; tick < 10000U; tick++) {
        terrapin_seal_at(&link.seal, tick);
        if (tick % 500U == 0U) { /* or the session ends, and no tag is looked at */
            open_session(&h, 7U);
        }
        for (uint32_t i = 0; i < 8U; i++) {
            terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
            h.time = 0U;
            frame.data[5] ^= 1U;
            const uint32_t before = link.seal.checks;
            (void)give(&frame);
            checked += (link.seal.checks != before) ? 1U : 0U; /* begins anew at 1, behind a full count of 20 */
        }
        TEST_ASSERT_LESS_OR_EQUAL(TERRAPIN_SEAL_CHECKS, link.seal.checks);
    }
    TEST_ASSERT_LESS_OR_EQUAL((20U * 10000U / 100U) + 20U, checked);
    TEST_ASSERT_GREATER_OR_EQUAL_MESSAGE((20U * 10000U / 100U) - 20U, checked, "and a session has its twenty");
}

static void test_a_tenth_of_a_second_ends_at_100_ms(void) {
    host h;
    terrapin_seal_at(&link.seal, 5000U);
    open_session(&h, 7U);
    for (uint32_t i = 0; i < TERRAPIN_SEAL_CHECKS; i++) {
        terrapin_frame wrong = sealed(&h, TERRAPIN_REQUEST_RUN);
        h.time = 0U;
        wrong.data[5] ^= 1U;
        TEST_ASSERT_FALSE(commands(&wrong));
    }
    terrapin_seal_at(&link.seal, 5099U);
    const terrapin_frame early = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_FALSE(commands(&early));
    terrapin_seal_at(&link.seal, 5100U);
    const terrapin_frame then = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&then));
}

/* Whole recorded sessions: before a reset, after it, and against another running session. TERRAPIN_SESSIONS says how
 * many; 10,000 take two seconds. */
static void test_whole_recorded_sessions(void) {
    const char *wanted = getenv("TERRAPIN_SESSIONS");
    const uint32_t sessions = (wanted != NULL) ? (uint32_t)strtoul(wanted, NULL, 10) : 10000U;
    uint32_t accepted = 0;
    for (uint32_t i = 0; i < sessions; i++) {
        host h;
        host other;
        terrapin_frame recorded[RECORDED];
        boot(draw());
        open_session(&h, i);
        const terrapin_frame asked = session_open(i, GENERATION);
        for (uint32_t k = 0; k < 8U; k++) {
            recorded[k] = sealed(&h, TERRAPIN_REQUEST_RUN);
            later(50U);
            TEST_ASSERT_TRUE(commands(&recorded[k]));
        }
        if (i % 2U == 0U) {
            boot(draw()); /* a reset: another start */
        }
        for (uint32_t again = 0; again < 2U; again++) {
            later(250U);
            (void)give(&asked);
            for (uint32_t k = 0; k < 8U; k++) {
                later(50U);
                accepted += commands(&recorded[k]) ? 1U : 0U;
            }
            open_session(&other, i + 1U);
            const terrapin_frame own = sealed(&other, TERRAPIN_REQUEST_IDLE);
            later(50U);
            TEST_ASSERT_TRUE(commands(&own));
        }
        if (sessions < 10U) {
            printf("session %lu\n", (unsigned long)i);
        }
    }
    TEST_ASSERT_EQUAL(0U, accepted);
}

static void test_five_percent_loss_refuses_nothing(void) {
    host h;
    uint32_t arrived = 0;
    uint32_t refused = 0;
    open_session(&h, 7U);
    while (arrived < 100000U) {
        if (sealed_host_ends(&h, link.seal.now_ms)) {
            open_session(&h, arrived);
        }
        const terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
        later(50U);
        if (draw() % 100U < 5U) {
            continue;
        }
        arrived++;
        refused += commands(&frame) ? 0U : 1U;
    }
    TEST_ASSERT_EQUAL(0U, refused);
}

static void test_a_stranger_ends_no_session(void) {
    host h;
    host next;
    open_session(&h, 7U);
    const terrapin_frame first = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&first));
    for (uint32_t i = 0; i < 1000U; i++) {
        later(1U);
        const terrapin_frame ask = session_open(draw(), GENERATION);
        (void)give(&ask);
        if (i % 50U == 0U) {
            const terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
            TEST_ASSERT_TRUE(commands(&frame));
        }
    }
    TEST_ASSERT_LESS_OR_EQUAL_UINT32(7U, link.seal.opened); /* one in 200 ms */
    later(300U);
    open_session(&next, 9U);
    const terrapin_frame late = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE_MESSAGE(commands(&late), "until the first good tag of the new one");
    const terrapin_frame fresh = sealed(&next, TERRAPIN_REQUEST_RUN);
    later(50U);
    TEST_ASSERT_TRUE(commands(&fresh));
    const terrapin_frame old = sealed(&h, TERRAPIN_REQUEST_RUN);
    later(50U);
    TEST_ASSERT_FALSE(commands(&old));
    const terrapin_frame wrong = session_open(1U, GENERATION - 1U);
    later(300U);
    const uint32_t refused = link.out_of_place;
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_NOTHING, give(&wrong), "a key of an earlier generation");
    TEST_ASSERT_EQUAL_MESSAGE(refused + 1U, link.out_of_place, "which is counted");
}

static void test_sessions_have_places(void) {
    host first;
    host second;
    host third;
    open_session(&first, 7U);
    terrapin_frame frame = sealed(&first, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&frame));
    open_session(&second, 8U);
    TEST_ASSERT_NOT_EQUAL(first.place, second.place);
    later(200U);
    open_session(&third, 9U); /* takes the place of the one that waited */
    TEST_ASSERT_EQUAL(second.place, third.place);
    frame = sealed(&second, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_FALSE_MESSAGE(commands(&frame), "another number, another key");
    later(10U);
    frame = sealed(&third, TERRAPIN_REQUEST_RUN);
    frame.data[0] ^= 0x80U;
    TEST_ASSERT_FALSE_MESSAGE(commands(&frame), "at the other one's place");
    frame.data[0] ^= 0x80U;
    TEST_ASSERT_TRUE(commands(&frame));
    frame = sealed(&first, TERRAPIN_REQUEST_RUN);
    later(10U);
    const uint16_t checked = link.seal.checks;
    TEST_ASSERT_FALSE_MESSAGE(commands(&frame), "it has ended");
    TEST_ASSERT_LESS_OR_EQUAL_MESSAGE(checked, link.seal.checks, "without a look at its tag");
    open_session(&second, 10U);
    TEST_ASSERT_EQUAL_MESSAGE(first.place, second.place, "which is free at once");
    TEST_ASSERT_EQUAL(4U, link.seal.opened);
    frame = sealed(&third, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE_MESSAGE(commands(&frame), "while another one waits");
    frame = sealed(&second, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&frame));
}

static void test_no_sealed_run_takes_the_place_of_an_idle(void) {
    host h;
    open_session(&h, 7U);
    const terrapin_frame idle = plain_command(TERRAPIN_REQUEST_IDLE, 3U);
    const terrapin_frame run = sealed(&h, TERRAPIN_REQUEST_RUN);
    (void)give(&idle);
    (void)give(&run);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
    TEST_ASSERT_EQUAL(1U, link.out_of_place);
    const terrapin_frame sealed_idle = sealed(&h, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(commands(&sealed_idle));
    TEST_ASSERT_EQUAL(1U, link.out_of_place);
}

static void test_no_session_of_generation_0(void) {
    terrapin_link_init(&link, &state, &inputs);
    terrapin_link_seal(&link, link_key, 0U, 1U); /* a key of which no session is to be opened */
    const terrapin_frame frame = session_open(7U, 0U);
    TEST_ASSERT_NOT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&frame));
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.opened);
}

static void test_short_frames_are_malformed(void) {
    host h;
    open_session(&h, 7U);
    terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
    frame.length = 7U;
    TEST_ASSERT_FALSE(commands(&frame));
    frame.id = TERRAPIN_ID_SEAL;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&frame));
    frame.id = TERRAPIN_ID_SESSION_OPEN;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&frame));
    TEST_ASSERT_EQUAL(3U, link.malformed);
    TEST_ASSERT_EQUAL(0U, link.unsealed);
    TEST_ASSERT_EQUAL(0U, link.seal.checks);
}

static void test_time_wraps_and_a_session_ends_at_16_s(void) {
    host h;
    open_session(&h, 7U);
    for (uint32_t i = 1; i < 2100U; i++) { /* past 256 each 2 s */
        later(8U);
        const terrapin_frame frame = sealed(&h, TERRAPIN_REQUEST_RUN);
        TEST_ASSERT_EQUAL_UINT32(i, h.time);
        TEST_ASSERT_EQUAL(i < 2048U, commands(&frame));
    }
    later(2000U);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.session[h.place].next);
}

static void test_a_seal_without_its_frame_takes_nothing(void) {
    host h;
    open_session(&h, 7U);
    const terrapin_frame write = write_of(radius() + 1, 0U);
    (void)give(&write);
    later(10U);
    const terrapin_frame seal = seal_of(&h, &write);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&seal));
    later(10U);
    const terrapin_frame again = seal_of(&h, &write); /* genuine, and of a frame that is not held any more */
    TEST_ASSERT_NULL(terrapin_seal_taken(&link.seal, &again));
}

static void test_a_command_between_a_frame_and_its_seal_costs_neither(void) {
    host h;
    open_session(&h, 7U);
    const terrapin_frame write = write_of(radius() + 1, 0U);
    (void)give(&write);
    later(10U);
    const terrapin_frame run = sealed(&h, TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_TRUE(commands(&run));
    later(10U);
    const terrapin_frame seal = seal_of(&h, &write);
    TEST_ASSERT_NOT_NULL(terrapin_seal_taken(&link.seal, &seal));
}

static void test_writes_wait_for_their_seal(void) {
    host h;
    open_session(&h, 7U);
    const int32_t before = radius();
    const terrapin_frame write = write_of(before + 1, 0U);
    const terrapin_frame other = write_of(before + 2, 1U);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&write));
    TEST_ASSERT_EQUAL_MESSAGE(before, radius(), "without a seal nothing happens");
    const terrapin_frame seal = seal_of(&h, &write);
    later(10U);
    const uint32_t unsealed = link.unsealed;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&other)); /* takes its place */
    TEST_ASSERT_EQUAL_MESSAGE(unsealed + 1U, link.unsealed, "the one before never got its seal");
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_NOTHING, give(&seal), "of another frame");
    TEST_ASSERT_EQUAL(before, radius());
    (void)give(&write);
    later(200U);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_REPLY, give(&seal), "a gateway may part them");
    TEST_ASSERT_EQUAL(before + 1, radius());
    (void)give(&other);
    later(10U);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_NOTHING, give(&seal), "used once");
    TEST_ASSERT_EQUAL(before + 1, radius());
    static const uint16_t ids[] = {TERRAPIN_ID_STORE_COMMAND, TERRAPIN_ID_TEST_MODE, TERRAPIN_ID_UPDATE_BEGIN,
                                   TERRAPIN_ID_UPDATE_END, TERRAPIN_ID_UPDATE_RESET};
    for (size_t i = 0; i < sizeof ids / sizeof ids[0]; i++) {
        terrapin_frame frame = {.id = ids[i], .length = 8U};
        terrapin_e2e_protect(&frame, 1U);
        later(20U);
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&frame));
        TEST_ASSERT_TRUE(link.seal.holding);
        const terrapin_frame good = seal_of(&h, &frame);
        const bool update = ids[i] >= TERRAPIN_ID_UPDATE_BEGIN;
        const terrapin_accept_result result = give(&good);
        TEST_ASSERT_FALSE(link.seal.holding);
        TEST_ASSERT_EQUAL(update, result == TERRAPIN_ACCEPT_UPDATE);
        if (update) {
            TEST_ASSERT_EQUAL_MEMORY(frame.data, link.seal.held.data, 8U);
            TEST_ASSERT_EQUAL(frame.id, link.seal.held.id);
        }
    }
}

static void test_it_keeps_its_memory_bound(void) {
    TEST_ASSERT_LESS_OR_EQUAL_MESSAGE(128U, sizeof(terrapin_seal), "with pointers of 64 bits, too");
}

/* For the comparison with Python: blocks from standard input, key and message of 16 bytes each, tags to standard
 * output. */
static int tags(void) {
    uint32_t words[8];
    while (fread(words, sizeof words, 1U, stdin) == 1U) {
        uint32_t tag[4];
        terrapin_chaskey(words, &words[4], tag);
        (void)fwrite(tag, sizeof tag, 1U, stdout);
    }
    return 0;
}

int main(int count, char **arguments) {
    if ((count > 1) && (strcmp(arguments[1], "--tags") == 0)) {
        return tags();
    }
    UNITY_BEGIN();
    RUN_TEST(test_the_published_vector);
    RUN_TEST(test_only_sealed_commands_but_idle_of_anybody);
    RUN_TEST(test_replayed_reordered_delayed_and_changed_frames);
    RUN_TEST(test_a_million_guessed_tags);
    RUN_TEST(test_at_most_twenty_tags_are_checked_in_a_tenth_of_a_second);
    RUN_TEST(test_a_tenth_of_a_second_ends_at_100_ms);
    RUN_TEST(test_whole_recorded_sessions);
    RUN_TEST(test_five_percent_loss_refuses_nothing);
    RUN_TEST(test_a_stranger_ends_no_session);
    RUN_TEST(test_sessions_have_places);
    RUN_TEST(test_no_sealed_run_takes_the_place_of_an_idle);
    RUN_TEST(test_no_session_of_generation_0);
    RUN_TEST(test_short_frames_are_malformed);
    RUN_TEST(test_time_wraps_and_a_session_ends_at_16_s);
    RUN_TEST(test_a_withheld_frame_is_taken_for_a_second_at_most);
    RUN_TEST(test_a_clock_may_be_a_little_before_this_one);
    RUN_TEST(test_a_session_ends_one_to_two_seconds_after_its_last_good_tag);
    RUN_TEST(test_a_session_ends_at_either_place_and_nothing_else);
    RUN_TEST(test_a_session_without_a_tag_ends_too);
    RUN_TEST(test_a_challenge_is_nobodys_to_tell);
    RUN_TEST(test_a_seal_without_its_frame_takes_nothing);
    RUN_TEST(test_a_command_between_a_frame_and_its_seal_costs_neither);
    RUN_TEST(test_writes_wait_for_their_seal);
    RUN_TEST(test_it_keeps_its_memory_bound);
    return UNITY_END();
}
