#include "analog.h"

#include "wait.h"

#define FIRST_CHANNEL 10U  /* of SMPR1; those below it are SMPR2's */
#define TRIES_STOP    100U /* a transfer under way ends within a few cycles */

void analog_open(analog *a, adc_registers *adc, adc_common_registers *common, dma_registers *dma, tim_registers *relay,
                 const uint8_t channels[ANALOG_CHANNELS]) {
    a->adc = adc;
    a->dma = dma;
    a->stream = &dma->stream[0];
    a->read = 0U;
    a->silent_ticks = 0U;
    for (uint32_t i = 0U; i < ANALOG_CHANNELS; i++) {
        a->codes[i] = 0U;
    }
    /* Stream 0, channel 0: ADC1 to memory, for ever. */
    a->stream->CR = 0U;
    dma->LIFCR = DMA_LIFCR_STREAM0;
    a->stream->PAR = (uint32_t)(uintptr_t)&adc->DR;
    a->stream->M0AR = (uint32_t)(uintptr_t)a->samples;
    a->stream->NDTR = ANALOG_ROUNDS * ANALOG_CHANNELS;
    a->stream->CR = DMA_CR_HALFWORDS | DMA_CR_MINC | DMA_CR_CIRC;
    a->stream->CR |= DMA_CR_EN;

    common->CCR = ADC_CCR_PCLK_BY_4;
    adc->CR1 = ADC_CR1_SCAN;
    adc->SQR1 = (ANALOG_CHANNELS - 1U) << 20U;
    adc->SQR3 = 0U;
    adc->SMPR1 = 0U;
    adc->SMPR2 = 0U;
    for (uint32_t i = 0U; i < ANALOG_CHANNELS; i++) {
        adc->SQR3 |= (uint32_t)channels[i] << (5U * i);
        if (channels[i] >= FIRST_CHANNEL) {
            adc->SMPR1 |= ADC_SMPR_15_CYCLES << (3U * (channels[i] - FIRST_CHANNEL));
        } else {
            adc->SMPR2 |= ADC_SMPR_15_CYCLES << (3U * channels[i]);
        }
    }
    adc->SR = 0U;
    adc->CR2 = ADC_CR2_ADON | ADC_CR2_DMA | ADC_CR2_DDS | ADC_CR2_TIM2_TRGO | ADC_CR2_RISING;

    relay->CR2 = TIM_CR2_MMS_RESET;
    relay->SMCR = TIM_SMCR_RESET; /* of ITR0: TIM1 */
    relay->ARR = 0xFFFFFFFFU;
    relay->CR1 = TIM_CR1_CEN;
}

/* A sample was not fetched in time and the chain has stopped: RM0090, 13.8.1 and 10.3.17. */
static void begin_anew(analog *a) {
    a->stream->CR &= ~DMA_CR_EN;
    (void)wait_for(&a->stream->CR, DMA_CR_EN, 0U, TRIES_STOP); /* if it does not stop, the samples stay away: told */
    a->dma->LIFCR = DMA_LIFCR_STREAM0;
    a->stream->NDTR = ANALOG_ROUNDS * ANALOG_CHANNELS;
    a->read = 0U;
    a->adc->CR2 &= ~ADC_CR2_DMA;
    a->adc->SR = 0U;
    a->stream->CR |= DMA_CR_EN;
    a->adc->CR2 |= ADC_CR2_DMA;
}

bool analog_read(analog *a) {
    /* NDTR counts down; whole rounds alone count. */
    const uint32_t left = a->stream->NDTR;
    const uint32_t total = ANALOG_ROUNDS * ANALOG_CHANNELS;
    const uint32_t written = ((left == 0U) || (left > total)) ? 0U : ((total - left) / ANALOG_CHANNELS);
    const uint32_t count = (written + ANALOG_ROUNDS - a->read) % ANALOG_ROUNDS;
    if ((a->adc->SR & ADC_SR_OVR) != 0U) {
        begin_anew(a);
    } else if (count > 0U) {
        uint32_t sums[ANALOG_CHANNELS] = {0};
        for (uint32_t n = 0U; n < count; n++) {
            const uint32_t at = ((a->read + n) % ANALOG_ROUNDS) * ANALOG_CHANNELS;
            for (uint32_t i = 0U; i < ANALOG_CHANNELS; i++) {
                sums[i] += a->samples[at + i] & 0xFFFU;
            }
        }
        for (uint32_t i = 0U; i < ANALOG_CHANNELS; i++) {
            a->codes[i] = (uint16_t)((sums[i] + (count / 2U)) / count);
        }
        a->read = written;
        a->silent_ticks = 0U;
        return true;
    } else {
        /* nothing new */
    }
    if (a->silent_ticks < ANALOG_SILENT) {
        a->silent_ticks++;
    }
    if (a->silent_ticks < ANALOG_SILENT) {
        return true;
    }
    for (uint32_t i = 0U; i < ANALOG_CHANNELS; i++) {
        a->codes[i] = 0U;
    }
    return false;
}
