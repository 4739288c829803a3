#define _GNU_SOURCE /* getopt_long */

#include "options.h"

#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "terrapin_interface.h"

static const char help[] =
    "usage: terrapin-controller --can INTERFACE [OPTION]...      the controller on a SocketCAN bus\n"
    "       terrapin-controller --adapter DEVICE [OPTION]...     the same through an SLCAN adapter on a serial port\n"
    "       terrapin-controller --off --enable LINE [--pwm DIR]  put the outputs off and end\n"
    "       terrapin-controller [--flash FILE] [--node N] [--link-key FILE] --pty [LINK] | DEVICE   speak SLCAN "
    "itself, as a board on USB does\n"
    "\n"
    "  --bitrate N              bit/s of the adapter (500000); ip link sets that of an interface\n"
    "  --estop LINE             input: active lets the robot run, inactive is the emergency stop or its broken wire\n"
    "  --enable LINE            output: active while the bridge may drive; needs --estop\n"
    "  --led LINE               output: lit driving, slow blinking idle, fast blinking fault, short flashes test mode\n"
    "  --debounce MS            the e-stop counts as released after so long (20); pressed at once\n"
    "  --motor-encoder A+B      inputs: quadrature, 4 counts a period, of the drive wheel\n"
    "  --ground-encoder A+B     the same of the trailing wheel\n"
    "  --adc-current FILE       raw codes of the motor current, as /sys/bus/iio/devices/iio:device0/in_voltage0_raw\n"
    "  --adc-supply FILE        of the bridge's supply\n"
    "  --adc-temperature FILE   of the winding's temperature\n"
    "  --adc-bits N             bits of these codes, 8 to 24 (12)\n"
    "  --pwm DIR                PWM channel, exported, with its period set, as /sys/class/pwm/pwmchip0/pwm0\n"
    "  --direction LINE         output: active for negative duty\n"
    "  --flash FILE             keep parameters and node number in FILE over a reset\n"
    "  --node N                 number of this controller on its bus, 0 to 7, whatever FILE says (0)\n"
    "  --link-key FILE          take commands and changes only from who has this key, too (terrapin keys link)\n"
    "  --priority N             SCHED_FIFO, 1 to 99 (50), 0 leaves the scheduler alone\n"
    "  --help, --version\n"
    "\n"
    "LINE is [CHIP:]NAME_OR_OFFSET[,active-low][,pull-up|pull-down]. SIGUSR1 prints counts and jitter; so does the "
    "end.\n"
    "Example: terrapin-controller --can can0 --estop gpiochip0:17,pull-down --enable gpiochip0:27 --led gpiochip0:22\n";

enum {
    CAN = 256,
    ADAPTER,
    BITRATE,
    ESTOP,
    ENABLE,
    LED,
    DIRECTION,
    DEBOUNCE,
    MOTOR,
    GROUND,
    CURRENT,
    SUPPLY,
    TEMPERATURE,
    ADC_BITS,
    PWM,
    FLASH,
    NODE,
    LINK_KEY,
    PRIORITY,
    OFF,
    HELP,
    VERSION
};

static const struct option known[] = {
    {"can", required_argument, NULL, CAN},
    {"adapter", required_argument, NULL, ADAPTER},
    {"bitrate", required_argument, NULL, BITRATE},
    {"estop", required_argument, NULL, ESTOP},
    {"enable", required_argument, NULL, ENABLE},
    {"led", required_argument, NULL, LED},
    {"direction", required_argument, NULL, DIRECTION},
    {"debounce", required_argument, NULL, DEBOUNCE},
    {"motor-encoder", required_argument, NULL, MOTOR},
    {"ground-encoder", required_argument, NULL, GROUND},
    {"adc-current", required_argument, NULL, CURRENT},
    {"adc-supply", required_argument, NULL, SUPPLY},
    {"adc-temperature", required_argument, NULL, TEMPERATURE},
    {"adc-bits", required_argument, NULL, ADC_BITS},
    {"pwm", required_argument, NULL, PWM},
    {"flash", required_argument, NULL, FLASH},
    {"node", required_argument, NULL, NODE},
    {"link-key", required_argument, NULL, LINK_KEY},
    {"priority", required_argument, NULL, PRIORITY},
    {"off", no_argument, NULL, OFF},
    {"help", no_argument, NULL, HELP},
    {"version", no_argument, NULL, VERSION},
    {NULL, 0, NULL, 0},
};

static bool wrong(const char *option, const char *why) {
    (void)fprintf(stderr, "terrapin-controller: %s: %s\n", option, why);
    return false;
}

static bool number(const char *option, long least, long most, long *value) {
    char *end = NULL;
    char why[80];
    *value = strtol(optarg, &end, 10);
    if ((end == optarg) || (*end != '\0') || (*value < least) || (*value > most)) {
        (void)snprintf(why, sizeof why, "found '%.20s', expected a number from %ld to %ld", optarg, least, most);
        return wrong(option, why);
    }
    return true;
}

static bool line(const char *option, const char *text, line_option *value) {
    char why[160];
    value->given = gpio_parse(text, &value->name, why, sizeof why);
    value->text = text;
    return value->given || wrong(option, why);
}

/* A+B; what follows B's comma is of both: "gpiochip0:5+gpiochip0:6,pull-up". */
static bool encoder(const char *option, line_option lines[2]) {
    char first[2 * GPIO_TEXT_MAX];
    const char *plus = strchr(optarg, '+');
    if ((plus == NULL) || ((size_t)(plus - optarg) >= (sizeof first - 1U))) {
        return wrong(option, "expected two lines, A+B");
    }
    (void)memcpy(first, optarg, (size_t)(plus - optarg));
    first[plus - optarg] = '\0';
    const bool good = line(option, plus + 1, &lines[1]) && line(option, first, &lines[0]);
    lines[0].text = optarg; /* not `first`, which ends here */
    if (!good) {
        return false;
    }
    lines[0].name.active_low = lines[1].name.active_low;
    lines[0].name.pull = lines[1].name.pull;
    return true;
}

static bool take(int option, controller_options *o) {
    long value = 0;
    bool good = true;
    switch (option) {
    case CAN:
        o->can = optarg;
        break;
    case ADAPTER:
        o->adapter = optarg;
        break;
    case BITRATE:
        good = number("--bitrate", 10000, 1000000, &value);
        o->bitrate = (unsigned int)value;
        break;
    case ESTOP:
        good = line("--estop", optarg, &o->estop);
        break;
    case ENABLE:
        good = line("--enable", optarg, &o->enable);
        break;
    case LED:
        good = line("--led", optarg, &o->led);
        break;
    case DIRECTION:
        good = line("--direction", optarg, &o->direction);
        break;
    case DEBOUNCE:
        good = number("--debounce", 1, 1000, &value);
        o->debounce_ms = (unsigned int)value;
        break;
    case MOTOR:
        good = encoder("--motor-encoder", o->motor);
        break;
    case GROUND:
        good = encoder("--ground-encoder", o->ground);
        break;
    case CURRENT:
        o->current = optarg;
        break;
    case SUPPLY:
        o->supply = optarg;
        break;
    case TEMPERATURE:
        o->temperature = optarg;
        break;
    case ADC_BITS:
        good = number("--adc-bits", 8, 24, &value);
        o->adc_bits = (unsigned int)value;
        break;
    case PWM:
        o->pwm = optarg;
        break;
    case FLASH:
        o->flash = optarg;
        break;
    case NODE:
        good = number("--node", 0, (long)TERRAPIN_NODES - 1, &value);
        o->node = (int)value;
        break;
    case LINK_KEY:
        o->link_key = optarg;
        break;
    case PRIORITY:
        good = number("--priority", 0, 99, &value);
        o->priority = (int)value;
        break;
    case OFF:
    default:
        o->off = true;
        break;
    }
    return good;
}

static bool consistent(const controller_options *o) {
    static const unsigned int bitrates[] = {10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000};
    bool rate = false;
    for (size_t i = 0; i < (sizeof bitrates / sizeof bitrates[0]); i++) {
        rate = rate || (o->bitrate == bitrates[i]);
    }
    if (!rate) {
        return wrong("--bitrate", "expected one of 10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, "
                                  "1000000");
    }
    if (o->off) {
        return o->enable.given || (o->pwm != NULL) || wrong("--off", "needs --enable or --pwm");
    }
    if ((o->can == NULL) == (o->adapter == NULL)) {
        return wrong("--can, --adapter", "expected one of them (--help shows an example)");
    }
    if ((o->enable.given || (o->pwm != NULL)) && !o->estop.given) {
        return wrong("--enable, --pwm", "need --estop: no bridge without an emergency stop");
    }
    return true;
}

options_result options_read(int argc, char **argv, controller_options *options) {
    const controller_options defaults = {
        .bitrate = 500000, .adc_bits = 12, .debounce_ms = 20, .priority = 50, .node = -1};
    int option = 0;
    *options = defaults;
    opterr = 0;
    while ((option = getopt_long(argc, argv, ":", known, NULL)) != -1) {
        if (option == HELP) {
            (void)fputs(help, stdout);
            return OPTIONS_DONE;
        }
        if (option == VERSION) {
            (void)printf("terrapin-controller, interface %d, %s\n", TERRAPIN_INTERFACE_VERSION, gpio_library);
            return OPTIONS_DONE;
        }
        if ((option == '?') || (option == ':')) {
            (void)wrong(argv[optind - 1], (option == ':') ? "needs a value" : "unknown option (see --help)");
            return OPTIONS_WRONG;
        }
        if (!take(option, options)) {
            return OPTIONS_WRONG;
        }
    }
    if (optind < argc) {
        (void)wrong(argv[optind], "unexpected (see --help)");
        return OPTIONS_WRONG;
    }
    return consistent(options) ? OPTIONS_RUN : OPTIONS_WRONG;
}
