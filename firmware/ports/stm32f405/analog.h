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

/* Begin; channels are the ADC's numbers for current, supply, temperature (10 to 18). */
void analog_open(analog *a, adc_registers *adc, adc_common_registers *common, dma_registers *dma, tim_registers *relay,
                 const uint8_t channels[ANALOG_CHANNELS]);

/* Once a tick: the mean codes since the last one, rounded; the last ones when nothing came, and 0, which the core takes
 * for a broken sensor, when nothing came for ANALOG_SILENT ticks (false then). */
bool analog_read(analog *a);

/* What one code is worth, in the raw units of parameters current_scale [uA] and supply_scale. Exact to the unit.
 * reference_mv over 4096 codes; shunt and amplifier; divider (upper + lower) / lower. */
#define ANALOG_UA_PER_CODE(reference_mv, shunt_uohm, gain)                                                             \
    ((int32_t)((((uint64_t)(reference_mv) * 1000000000U) + (((uint64_t)(shunt_uohm) * (gain) * 4096U) / 2U)) /         \
               ((uint64_t)(shunt_uohm) * (gain) * 4096U)))
#define ANALOG_UV_PER_CODE(reference_mv, upper_ohm, lower_ohm)                                                         \
    ((int32_t)((((uint64_t)(reference_mv) * 1000U * ((upper_ohm) + (lower_ohm))) +                                     \
                (((uint64_t)(lower_ohm) * 4096U) / 2U)) /                                                              \
               ((uint64_t)(lower_ohm) * 4096U)))

#endif
