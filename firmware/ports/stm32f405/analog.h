/* Current, supply and winding temperature: ADC1 samples them in the middle of every PWM period, DMA lays them down, the
 * tick takes the mean of what came since the last one.
 *
 * TIM1's compare 3 starts a conversion by way of TIM2, which passes the trigger on: TIM1 itself cannot start regular
 * conversions while its outputs are off (its channels start them behind the output stage).
 */
#ifndef TERRAPIN_ANALOG_H
#define TERRAPIN_ANALOG_H

#include "registers.h"

#define ANALOG_CHANNELS 3U
#define ANALOG_ROUNDS   64U /* of samples that are kept: three ticks of 20 */
#define ANALOG_SILENT   3U  /* ticks without a new sample until they count as missing */

typedef struct {
    adc_registers *adc;
    dma_registers *dma;
    dma_stream_registers *stream;
    uint32_t read;         /* rounds read so far, modulo ANALOG_ROUNDS */
    uint32_t silent_ticks; /* stops at ANALOG_SILENT */
    uint16_t codes[ANALOG_CHANNELS];
    volatile uint16_t samples[ANALOG_ROUNDS * ANALOG_CHANNELS]; /* written by DMA */
} analog;

/* Begin; channels are the ADC's numbers for current, supply, temperature (0 to 15). */
void analog_open(analog *a, adc_registers *adc, adc_common_registers *common, dma_registers *dma, tim_registers *relay,
                 const uint8_t channels[ANALOG_CHANNELS]);

/* Once a tick: the mean codes since the last one, rounded; the last ones when nothing came, and 0, which the core takes
 * for a broken sensor, when nothing came for ANALOG_SILENT ticks (false then). */
bool analog_read(analog *a);

#endif
