#include "bridge.h"

#include "wait.h"

#define TRIGGER_CLOCKS 8U /* before the top, 48 ns; TIM2, at half of TIM1's clock, could miss a pulse of one or two */

uint32_t bridge_dead_time(uint32_t timer_hz, uint16_t dead_time_ns) {
    const uint32_t steps = (uint32_t)((((uint64_t)timer_hz * dead_time_ns) + 999999999U) / 1000000000U);
    if (steps < 128U) {
        return steps;
    }
    if (steps <= 254U) { /* (64 + n) * 2 */
        return 0x80U + (((steps + 1U) / 2U) - 64U);
    }
    if (steps <= 504U) { /* (32 + n) * 8 */
        return 0xC0U + (((steps + 7U) / 8U) - 32U);
    }
    if (steps <= 1008U) { /* (32 + n) * 16 */
        return 0xE0U + (((steps + 15U) / 16U) - 32U);
    }
    return 0xFFU;
}

void bridge_open(bridge *b, tim_registers *timer, uint32_t timer_hz, uint32_t pwm_hz, uint16_t dead_time_ns) {
    b->timer = timer;
    b->period = (uint16_t)(timer_hz / (2U * pwm_hz));
    b->broken = false;
    timer->PSC = 0U;
    timer->ARR = b->period;
    timer->CCMR1 = TIM_CCMR1_PWM;
    timer->CCMR2 = TIM_CCMR2_PWM3;
    timer->CCER = TIM_CCER_BRIDGE;
    timer->CCR1 = 0U;
    timer->CCR2 = 0U;
    /* Its reference is high around the top, where both low sides conduct: sample there. */
    timer->CCR3 = (uint32_t)b->period - TRIGGER_CLOCKS;
    timer->CR2 = TIM_CR2_MMS_OC3REF;
    timer->EGR = TIM_EGR_UG; /* preloaded values in force */
    /* Off means driven off, not floating. The break input is active low; AOE stays 0: only software switches on. The
     * first write to this register since the reset: only that one can set the lock (RM0090, 17.4.18). */
    TERRAPIN_PUT(timer->BDTR, TIM_BDTR_OSSI | TIM_BDTR_OSSR | TIM_BDTR_BKE | TIM_BDTR_LOCK_1 |
                                  bridge_dead_time(timer_hz, dead_time_ns));
    timer->SR = 0U;
    timer->CR1 = TIM_CR1_CENTRE | TIM_CR1_ARPE | TIM_CR1_CEN;
}

void bridge_off(tim_registers *timer) {
    TERRAPIN_PUT(timer->BDTR, timer->BDTR & ~TIM_BDTR_MOE);
}

void bridge_drive(bridge *b, int16_t duty_q15, bool on) {
    tim_registers *timer = b->timer;
    if ((timer->SR & TIM_SR_BIF) != 0U) {
        b->broken = true;
        timer->SR = ~TIM_SR_BIF; /* cleared by a zero; comes back while the input is active */
    } else if (!on) {
        b->broken = false;
    } else {
        /* quiet */
    }
    if (!on || b->broken) {
        TERRAPIN_PUT(timer->BDTR, timer->BDTR & ~TIM_BDTR_MOE);
        timer->CCR1 = 0U;
        timer->CCR2 = 0U;
        return;
    }
    /* One side switches, the other's low transistor conducts. */
    const bool back = duty_q15 < 0;
    const uint32_t size = (uint32_t)(back ? -(int32_t)duty_q15 : (int32_t)duty_q15);
    const uint32_t compare = ((size * b->period) + 16384U) >> 15U;
    timer->CCR1 = back ? 0U : compare;
    timer->CCR2 = back ? compare : 0U;
    TERRAPIN_PUT(timer->BDTR, timer->BDTR | TIM_BDTR_MOE);
}
