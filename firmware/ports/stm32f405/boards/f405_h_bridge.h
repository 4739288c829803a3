/* A generic STM32F405VG (LQFP100) with one H-bridge for the drive motor, as docs/stm32f405.md draws it. */
#ifndef TERRAPIN_BOARD_H
#define TERRAPIN_BOARD_H

#include "analog.h"
#include "pins.h"
#include "terrapin_interface.h"

#define BOARD_NUMBER      TERRAPIN_BOARD_F405_H_BRIDGE
#define BOARD_CRYSTAL_HZ  8000000U
#define BOARD_INTERNAL_HZ 16000000U /* without the crystal */
#define BOARD_CAN_BIT_S   500000U
#define BOARD_BAUD        1000000U /* 44 bytes a tick are 44 % of it */

#define BOARD_PWM_HZ          20000U
#define BOARD_DEAD_TIME_NS    500U
#define BOARD_MOTOR_REVERSED  false
#define BOARD_GROUND_REVERSED false

/* Current: 20 mohm in line with the motor, amplifier of 40 about half the reference. Supply: 47 k over 10 k. */
#define BOARD_REFERENCE_MV 3300U
#define BOARD_SHUNT_UOHM   20000U
#define BOARD_CURRENT_GAIN 40U
#define BOARD_SUPPLY_UPPER 47000U
#define BOARD_SUPPLY_LOWER 10000U
#define BOARD_CHANNELS     {10U, 11U, 12U} /* PC0 current, PC1 supply, PC2 winding temperature */

/* What the board knows of the controller's parameters, raw; the stored ones come after these. */
#define BOARD_PARAMETERS                                                                                               \
    {                                                                                                                  \
        {TERRAPIN_PARAMETER_CURRENT_SCALE,                                                                             \
         ANALOG_UA_PER_CODE(BOARD_REFERENCE_MV, BOARD_SHUNT_UOHM, BOARD_CURRENT_GAIN)},                                \
        {TERRAPIN_PARAMETER_SUPPLY_SCALE,                                                                              \
         ANALOG_UV_PER_CODE(BOARD_REFERENCE_MV, BOARD_SUPPLY_UPPER, BOARD_SUPPLY_LOWER)},                              \
    }

/* port (0 is A), number, mode, pull, function */
#define BOARD_ESTOP  {4U, 0U, PIN_INPUT, PIN_UP, 0U}        /* PE0: opened by the emergency stop, or broken: high */
#define BOARD_ENABLE {4U, 14U, PIN_OUTPUT, PIN_DOWN, 0U}    /* PE14: gate driver awake */
#define BOARD_LED    {4U, 1U, PIN_OUTPUT, PIN_FLOATING, 0U} /* PE1 */
#define BOARD_PINS                                                                                                     \
    {                                                                                                                  \
        {4U, 8U, PIN_FUNCTION, PIN_DOWN, 1U},     /* PE8 TIM1 CH1N: pulled low, so that reset keeps the bridge off */  \
        {4U, 9U, PIN_FUNCTION, PIN_DOWN, 1U},     /* PE9 TIM1 CH1 */                                                   \
        {4U, 10U, PIN_FUNCTION, PIN_DOWN, 1U},    /* PE10 TIM1 CH2N */                                                 \
        {4U, 11U, PIN_FUNCTION, PIN_DOWN, 1U},    /* PE11 TIM1 CH2 */                                                  \
        {4U, 15U, PIN_FUNCTION, PIN_DOWN, 1U},    /* PE15 TIM1 BKIN: low is a fault; so is a broken wire */            \
        {0U, 9U, PIN_FUNCTION, PIN_UP, 7U},       /* PA9 USART1 TX, where the chip's own boot loader is, too */        \
        {0U, 10U, PIN_FUNCTION, PIN_UP, 7U},      /* PA10 USART1 RX */                                                 \
        {1U, 8U, PIN_FUNCTION, PIN_UP, 9U},       /* PB8 CAN1 RX */                                                    \
        {1U, 9U, PIN_FUNCTION, PIN_FLOATING, 9U}, /* PB9 CAN1 TX */                                                    \
        {2U, 6U, PIN_FUNCTION, PIN_UP, 2U},       /* PC6 TIM3 CH1: motor encoder A */                                  \
        {2U, 7U, PIN_FUNCTION, PIN_UP, 2U},       /* PC7 TIM3 CH2: motor encoder B */                                  \
        {1U, 6U, PIN_FUNCTION, PIN_UP, 2U},       /* PB6 TIM4 CH1: ground wheel A */                                   \
        {1U, 7U, PIN_FUNCTION, PIN_UP, 2U},       /* PB7 TIM4 CH2: ground wheel B */                                   \
        {2U, 0U, PIN_ANALOG, PIN_FLOATING, 0U},   /* PC0 */                                                            \
        {2U, 1U, PIN_ANALOG, PIN_FLOATING, 0U},   /* PC1 */                                                            \
        {2U, 2U, PIN_ANALOG, PIN_FLOATING, 0U},   /* PC2 */                                                            \
    }

#endif
