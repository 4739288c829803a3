/* QEMU's netduinoplus2: an STM32F405's core, SysTick and USART1, and registers that read 0 for nearly all the rest. It
 * is the robot's board but for two things: no crystal ever comes, and the core runs at 168 MHz all the same.
 */
#ifndef TERRAPIN_BOARD_EMULATED_H
#define TERRAPIN_BOARD_EMULATED_H

#include "terrapin_board.h" /* made of the board's file */

#undef BOARD_NUMBER
#undef BOARD_INTERNAL_HZ
#define BOARD_NUMBER      TERRAPIN_BOARD_EMULATED
#define BOARD_INTERNAL_HZ 168000000U

#endif
