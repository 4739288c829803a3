/* The controller's image: chip, bus, line and port put together. What is decided is decided in the other files. */
#include "boards/selected.h"
#include "hardware.h"
#include "instructions.h"
#include "port.h"
#include "startup.h"
#include "terrapin_interface.h"

/* What `terrapin image sign` reads, and puts into the image's header: name, robot with board, version of the interface.
 */
typedef struct {
    char name[16];
    uint32_t made_for;
    uint32_t interface;
} image_made;
__attribute__((used, section(".made"))) static const image_made made = {
    "terrapin-made", (uint32_t)TERRAPIN_ROBOT_IDENTITY | ((uint32_t)BOARD_NUMBER << 24U), TERRAPIN_INTERFACE_VERSION};

static can bus;
static usart line;
static port controller;
static uint64_t state[TERRAPIN_STATE_BYTES / 8U];

void usart1_interrupt(void) {
    usart_interrupt(&line);
}

void can1_receive_interrupt(void) {
    can_receive_interrupt(&bus);
}

static void enable_interrupt(uint32_t number) {
    NVIC_ISER[number / 32U] = BIT(number % 32U);
}

_Noreturn void application(void) {
    const uint32_t flags = RCC->CSR;
    const clocks speed = clock_start(RCC, FLASH, PWR, BOARD_CRYSTAL_HZ, BOARD_INTERNAL_HZ);
    hardware_open(&speed);
    usart_open(&line, USART1, speed.apb2_hz, BOARD_BAUD);
    terrapin_update *update = hardware_update();
    const hardware_facts facts = hardware_look(&speed, flags);
    terrapin_node node;
    terrapin_filter filters[TERRAPIN_BLOCK_RECEIVED]; /* all other traffic stays in the chip */
    terrapin_node_init(&node, facts.node);
    terrapin_node_filters(&node, filters);
    (void)can_open(&bus, CAN1, can_timing(speed.apb1_hz, BOARD_CAN_BIT_S), filters, TERRAPIN_BLOCK_RECEIVED);

    port_open(&controller, (terrapin_state *)state, &bus, &line, hardware_store(), update, &facts);
    enable_interrupt(IRQ_USART1);
    enable_interrupt(IRQ_CAN1_RX0);
    hardware_start(speed.core_hz);
    for (;;) {
        if (!port_pass(&controller, hardware_ticks())) {
            /* Masked, so that what comes between the last look and the sleep still ends it. */
            interrupts_off();
            if ((hardware_ticks() == controller.tick) && (ring_used(&line.in) == 0U) && (bus.in_head == bus.in_tail)) {
                sleep_until_interrupt();
            }
            interrupts_on();
        }
    }
}
