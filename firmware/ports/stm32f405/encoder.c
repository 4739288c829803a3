#include "encoder.h"

void encoder_open(tim_registers *timer, bool reversed) {
    timer->CR1 = 0U;
    timer->SMCR = TIM_SMCR_ENCODER;
    timer->CCMR1 = TIM_CCMR1_INPUTS;
    timer->CCER = reversed ? BIT(1) : 0U; /* one input upside down counts the other way */
    timer->ARR = 0xFFFFU;
    timer->CNT = 0U;
    timer->CR1 = TIM_CR1_CEN;
}

uint16_t encoder_read(const tim_registers *timer) {
    return (uint16_t)timer->CNT;
}
