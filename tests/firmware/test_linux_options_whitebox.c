/* The Linux controller's command line and names of lines: what is taken, what is refused, and that no bridge is had
 * without an e-stop. */
#define _GNU_SOURCE

#include "unity.h"

#include <stdio.h>

#include "../../firmware/ports/linux/gpio.c"
#include "../../firmware/ports/linux/gpio_none.c"
#undef option
static FILE *said; /* where a test reads what is told */
static FILE *its_stderr(void) {
    return (said != NULL) ? said : stderr;
}
#undef stderr
#define stderr its_stderr()
#include "../../firmware/ports/linux/options.c"

static controller_options o;

void setUp(void) {
    o = (controller_options){0};
}
void tearDown(void) {}

/* Words between spaces; what getopt keeps between two command lines is begun anew. */
static options_result reads(const char *text) {
    static char copy[512];
    char *words[64] = {NULL};
    int count = 1;
    (void)snprintf(copy, sizeof copy, "controller %s", text);
    words[0] = strtok(copy, " ");
    for (char *word = strtok(NULL, " "); (word != NULL) && (count < 63); word = strtok(NULL, " ")) {
        words[count] = word;
        count++;
    }
    optind = 0;
    return options_read(count, words, &o);
}

static void test_defaults(void) {
    TEST_ASSERT_EQUAL(OPTIONS_RUN, reads("--can can0"));
    TEST_ASSERT_EQUAL_STRING("can0", o.can);
    TEST_ASSERT_NULL(o.adapter);
    TEST_ASSERT_EQUAL(500000, o.bitrate);
    TEST_ASSERT_EQUAL(12, o.adc_bits);
    TEST_ASSERT_EQUAL(20, o.debounce_ms);
    TEST_ASSERT_EQUAL(50, o.priority);
    TEST_ASSERT_EQUAL(-1, o.node);
    TEST_ASSERT_FALSE(o.off || o.estop.given || o.enable.given || o.led.given || o.direction.given);
    TEST_ASSERT_FALSE(o.motor[0].given || o.motor[1].given || o.ground[0].given || o.ground[1].given);
    TEST_ASSERT_TRUE((o.pwm == NULL) && (o.flash == NULL) && (o.link_key == NULL));
}

static void test_every_option_goes_to_its_place(void) {
    TEST_ASSERT_EQUAL(
        OPTIONS_RUN,
        reads("--adapter dev --bitrate 250000 --estop c:1,pull-down --enable c:2 --led c:3,active-low --direction c:4 "
              "--debounce 7 --motor-encoder c:5+c:6,pull-up --ground-encoder c:7+c:8,active-low --adc-current f1 "
              "--adc-supply f2 --adc-temperature f3 --adc-bits 16 --pwm f4 --flash f5 --node 3 --link-key f6 "
              "--priority 9"));
    TEST_ASSERT_EQUAL_STRING("dev", o.adapter);
    TEST_ASSERT_EQUAL(250000, o.bitrate);
    TEST_ASSERT_EQUAL_STRING("1", o.estop.name.line);
    TEST_ASSERT_EQUAL(GPIO_PULL_DOWN, o.estop.name.pull);
    TEST_ASSERT_EQUAL_STRING("2", o.enable.name.line);
    TEST_ASSERT_EQUAL(GPIO_PULL_AS_IS, o.enable.name.pull);
    TEST_ASSERT_FALSE(o.enable.name.active_low);
    TEST_ASSERT_EQUAL_STRING("3", o.led.name.line);
    TEST_ASSERT_TRUE(o.led.name.active_low);
    TEST_ASSERT_EQUAL_STRING("4", o.direction.name.line);
    TEST_ASSERT_EQUAL(7, o.debounce_ms);
    TEST_ASSERT_EQUAL_STRING("5", o.motor[0].name.line);
    TEST_ASSERT_EQUAL_STRING("6", o.motor[1].name.line);
    TEST_ASSERT_TRUE(o.motor[0].given && o.motor[1].given);
    TEST_ASSERT_EQUAL(GPIO_PULL_UP, o.motor[0].name.pull);
    TEST_ASSERT_EQUAL(GPIO_PULL_UP, o.motor[1].name.pull);
    TEST_ASSERT_EQUAL_STRING("7", o.ground[0].name.line);
    TEST_ASSERT_EQUAL_STRING("8", o.ground[1].name.line);
    TEST_ASSERT_TRUE(o.ground[0].name.active_low && o.ground[1].name.active_low);
    TEST_ASSERT_EQUAL_STRING("c", o.ground[0].name.chip);
    TEST_ASSERT_EQUAL_STRING("c:7+c:8,active-low", o.ground[0].text);
    TEST_ASSERT_EQUAL_STRING("f1", o.current);
    TEST_ASSERT_EQUAL_STRING("f2", o.supply);
    TEST_ASSERT_EQUAL_STRING("f3", o.temperature);
    TEST_ASSERT_EQUAL(16, o.adc_bits);
    TEST_ASSERT_EQUAL_STRING("f4", o.pwm);
    TEST_ASSERT_EQUAL_STRING("f5", o.flash);
    TEST_ASSERT_EQUAL(3, o.node);
    TEST_ASSERT_EQUAL_STRING("f6", o.link_key);
    TEST_ASSERT_EQUAL(9, o.priority);
}

static void test_no_bridge_without_an_estop(void) {
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --enable c:1"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --pwm f"));
    TEST_ASSERT_EQUAL(OPTIONS_RUN, reads("--can can0 --enable c:1 --estop c:2"));
    TEST_ASSERT_EQUAL(OPTIONS_RUN, reads("--can can0 --pwm f --estop c:2"));
}

static void test_one_bus(void) {
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--estop c:2"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --adapter dev"));
    TEST_ASSERT_EQUAL(OPTIONS_RUN, reads("--off --enable c:1"));
    TEST_ASSERT_TRUE(o.off);
    TEST_ASSERT_EQUAL(OPTIONS_RUN, reads("--off --pwm f"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--off"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--off --estop c:1"));
}

static void test_numbers_have_both_their_ends(void) {
    static const struct {
        const char *option;
        long least, most;
    } ranges[] = {{"debounce", 1, 1000}, {"adc-bits", 8, 24}, {"node", 0, TERRAPIN_NODES - 1}, {"priority", 0, 99}};
    char text[64];
    for (size_t i = 0; i < (sizeof ranges / sizeof ranges[0]); i++) {
        for (long at = -1; at <= 1; at++) {
            (void)snprintf(text, sizeof text, "--can can0 --%s %ld", ranges[i].option, ranges[i].least + at);
            TEST_ASSERT_EQUAL((at >= 0) ? OPTIONS_RUN : OPTIONS_WRONG, reads(text));
            (void)snprintf(text, sizeof text, "--can can0 --%s %ld", ranges[i].option, ranges[i].most + at);
            TEST_ASSERT_EQUAL((at <= 0) ? OPTIONS_RUN : OPTIONS_WRONG, reads(text));
        }
    }
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --debounce 5ms"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --debounce x"));
    static const unsigned int rates[] = {10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000};
    for (size_t i = 0; i < (sizeof rates / sizeof rates[0]); i++) {
        (void)snprintf(text, sizeof text, "--can can0 --bitrate %u", rates[i]);
        TEST_ASSERT_EQUAL(OPTIONS_RUN, reads(text));
        (void)snprintf(text, sizeof text, "--can can0 --bitrate %u", rates[i] + 1U);
        TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads(text));
    }
}

static void test_other_words(void) {
    TEST_ASSERT_EQUAL(OPTIONS_DONE, reads("--version"));
    TEST_ASSERT_EQUAL(OPTIONS_DONE, reads("--help"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--nothing"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 more"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --motor-encoder c:5"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --motor-encoder c:5+6"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --motor-encoder 5+c:6"));
    TEST_ASSERT_EQUAL(OPTIONS_WRONG, reads("--can can0 --estop c:1,down"));
}

static void test_what_is_wrong_is_named_with_what_is_expected(void) {
    static const struct {
        const char *words, *told;
    } cases[] = {
        {"--off", "--off: needs --enable or --pwm"},
        {"--can can0 --node=", "--node: found '', expected a number from 0 to 7"},
        {"--can can0 --priority=", "--priority: found '', expected a number from 0 to 99"},
        {"--can can0 --adc-bits 25", "--adc-bits: found '25', expected a number from 8 to 24"},
        {"--can can0 --bitrate 9999", "--bitrate: found '9999', expected a number from 10000 to 1000000"},
        {"--can can0 --bitrate 10001",
         "--bitrate: expected one of 10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000"},
        {"--can can0 --estop 17", "--estop: "},
        {"--can can0 --ground-encoder c:5", "--ground-encoder: expected two lines, A+B"},
        {"--can can0 --adapter x", "--can, --adapter: expected one of them (--help shows an example)"},
        {"--can can0 --pwm x", "--enable, --pwm: need --estop: no bridge without an emergency stop"},
        {"--can can0 --wheel", "--wheel: unknown option (see --help)"},
        {"--can", "--can: needs a value"},
        {"--can can0 more", "more: unexpected (see --help)"},
    };
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        char *text = NULL;
        char wanted[200];
        size_t size = 0;
        said = open_memstream(&text, &size);
        TEST_ASSERT_NOT_NULL(said);
        TEST_ASSERT_EQUAL_MESSAGE(OPTIONS_WRONG, reads(cases[i].words), cases[i].words);
        (void)fclose(said);
        said = NULL;
        (void)snprintf(wanted, sizeof wanted, "terrapin-controller: %s", cases[i].told);
        TEST_ASSERT_EQUAL_STRING_LEN(wanted, text, strlen(wanted));
        TEST_ASSERT_EQUAL_PTR_MESSAGE(&text[size - 1U], strchr(text, '\n'), "one line");
        free(text);
    }
}

static void test_names_of_lines(void) {
    char why[160];
    char text[200];
    gpio_name name;
    TEST_ASSERT_TRUE(gpio_parse("ESTOP,active-low,pull-up", &name, why, sizeof why));
    TEST_ASSERT_EQUAL_STRING("", name.chip);
    TEST_ASSERT_EQUAL_STRING("ESTOP", name.line);
    TEST_ASSERT_TRUE(name.active_low);
    TEST_ASSERT_EQUAL(GPIO_PULL_UP, name.pull);
    TEST_ASSERT_TRUE(gpio_parse("/dev/gpiochip0:17", &name, why, sizeof why));
    TEST_ASSERT_EQUAL_STRING("/dev/gpiochip0", name.chip);
    TEST_ASSERT_EQUAL_STRING("17", name.line);
    TEST_ASSERT_FALSE(gpio_parse("17", &name, why, sizeof why)); /* of which chip? */
    TEST_ASSERT_FALSE(gpio_parse(":17", &name, why, sizeof why));
    TEST_ASSERT_FALSE(gpio_parse("c:", &name, why, sizeof why));
    TEST_ASSERT_FALSE(gpio_parse("", &name, why, sizeof why));
    for (int length = 62; length < 200; length++) { /* 63 letters are the most of chip and of line */
        (void)memset(text, 'x', sizeof text);
        text[(length < 199) ? length : 199] = '\0';
        TEST_ASSERT_EQUAL(length < GPIO_TEXT_MAX, gpio_parse(text, &name, why, sizeof why));
        if (length < 190) {
            (void)memcpy(&text[length], ":y", 3U);
            TEST_ASSERT_EQUAL(length < GPIO_TEXT_MAX, gpio_parse(text, &name, why, sizeof why));
        }
    }
    TEST_ASSERT_EQUAL(0, gpio_offset("0"));
    TEST_ASSERT_EQUAL(9, gpio_offset("9"));
    TEST_ASSERT_EQUAL(-1, gpio_offset("9x"));
    TEST_ASSERT_EQUAL(-1, gpio_offset("-1"));
    TEST_ASSERT_EQUAL(-1, gpio_offset(""));
    TEST_ASSERT_EQUAL(-1, gpio_offset(" 1"));
}

static void test_without_libgpiod_nothing_is_had(void) {
    char why[160];
    gpio_name name;
    gpio_edge edge;
    TEST_ASSERT_TRUE(gpio_parse("c:1", &name, why, sizeof why));
    TEST_ASSERT_NULL(gpio_open(&name, GPIO_OUTPUT, why, sizeof why));
    TEST_ASSERT_EQUAL(-1, gpio_get(NULL));
    TEST_ASSERT_FALSE(gpio_set(NULL, true));
    TEST_ASSERT_EQUAL(-1, gpio_descriptor(NULL));
    TEST_ASSERT_EQUAL(-1, gpio_edges(NULL, &edge, 1));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_defaults);
    RUN_TEST(test_every_option_goes_to_its_place);
    RUN_TEST(test_no_bridge_without_an_estop);
    RUN_TEST(test_one_bus);
    RUN_TEST(test_numbers_have_both_their_ends);
    RUN_TEST(test_other_words);
    RUN_TEST(test_what_is_wrong_is_named_with_what_is_expected);
    RUN_TEST(test_names_of_lines);
    RUN_TEST(test_without_libgpiod_nothing_is_had);
    return UNITY_END();
}
