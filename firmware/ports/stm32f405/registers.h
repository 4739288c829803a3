/* Registers of the STM32F405 that this port uses, and no others. Facts from ST's RM0090 (peripherals) and Arm's DDI
 * 0403 (core); names are the manual's. A driver gets a pointer to its block, so that a test can give it a block of its
 * own.
 */
#ifndef TERRAPIN_REGISTERS_H
#define TERRAPIN_REGISTERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef volatile uint32_t reg32;
typedef volatile uint16_t reg16;

#define BIT(n) (UINT32_C(1) << (n))

/* ---- RCC: reset and clock control (RM0090, 7) */
typedef struct {
    reg32 CR, PLLCFGR, CFGR, CIR;
    reg32 AHB1RSTR, AHB2RSTR, AHB3RSTR, reserved0, APB1RSTR, APB2RSTR, reserved1[2];
    reg32 AHB1ENR, AHB2ENR, AHB3ENR, reserved2, APB1ENR, APB2ENR, reserved3[2];
    reg32 AHB1LPENR, AHB2LPENR, AHB3LPENR, reserved4, APB1LPENR, APB2LPENR, reserved5[2];
    reg32 BDCR, CSR;
} rcc_registers;
#define RCC_AHB2ENR_RNG BIT(6)

/* Random numbers, RM0090, chapter 24 */
typedef struct {
    reg32 CR, SR, DR;
} rng_registers;
#define RNG_CR_RNGEN  BIT(2)
#define RNG_SR_DRDY   BIT(0)
#define RNG_SR_ERRORS (3U << 5U) /* of clock or seed, some time */
_Static_assert(offsetof(rcc_registers, AHB1ENR) == 0x30, "RM0090, 7.3.28");
_Static_assert(offsetof(rcc_registers, CSR) == 0x74, "RM0090, 7.3.28");

#define RCC_CR_HSION      BIT(0)
#define RCC_CR_HSIRDY     BIT(1)
#define RCC_CR_HSEON      BIT(16)
#define RCC_CR_HSERDY     BIT(17)
#define RCC_CR_CSSON      BIT(19)
#define RCC_CR_PLLON      BIT(24)
#define RCC_CR_PLLRDY     BIT(25)
#define RCC_PLLCFGR_N     6U /* first bit of PLLN, and so on */
#define RCC_PLLCFGR_P     16U
#define RCC_PLLCFGR_HSE   BIT(22)
#define RCC_PLLCFGR_Q     24U
#define RCC_PLLCFGR_ALL   0x0F437FFFU /* the rest is reserved, and kept */
#define RCC_CFGR_SW       (BIT(0) | BIT(1))
#define RCC_CFGR_SW_PLL   BIT(1)
#define RCC_CFGR_SWS      (BIT(2) | BIT(3))
#define RCC_CFGR_SWS_PLL  BIT(3)
#define RCC_CFGR_PRE      0x0000FCF0U /* HPRE, PPRE1, PPRE2 */
#define RCC_CFGR_PPRE1_4  (5U << 10U)
#define RCC_CFGR_PPRE2_2  (4U << 13U)
#define RCC_AHB1_GPIO_ALL 0x1FU /* ports A to E */
#define RCC_AHB1_DMA2     BIT(22)
#define RCC_APB1_TIM2     BIT(0)
#define RCC_APB1_TIM3     BIT(1)
#define RCC_APB1_TIM4     BIT(2)
#define RCC_APB1_CAN1     BIT(25)
#define RCC_APB1_PWR      BIT(28)
#define RCC_APB2_TIM1     BIT(0)
#define RCC_APB2_USART1   BIT(4)
#define RCC_APB2_ADC1     BIT(8)
#define RCC_APB2_SPI1     BIT(12)
#define RCC_CSR_RMVF      BIT(24)
#define RCC_CSR_BORRSTF   BIT(25)
#define RCC_CSR_PINRSTF   BIT(26)
#define RCC_CSR_PORRSTF   BIT(27)
#define RCC_CSR_SFTRSTF   BIT(28)
#define RCC_CSR_IWDGRSTF  BIT(29)
#define RCC_CSR_WWDGRSTF  BIT(30)
#define RCC_CSR_LPWRRSTF  BIT(31)

/* ---- PWR: supply of the chip (RM0090, 5) */
typedef struct {
    reg32 CR, CSR;
} pwr_registers;
#define PWR_CR_PVDE     BIT(4)
#define PWR_CR_PLS_2V7  (5U << 5U) /* about 2.7 V, DS8626 table 19 */
#define PWR_CR_VOS_FAST BIT(14)    /* scale 1: up to 168 MHz */
#define PWR_CSR_PVDO    BIT(2)

/* ---- FLASH: the interface to the flash memory (RM0090, 3) */
typedef struct {
    reg32 ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
} flash_registers;
#define FLASH_ACR_LATENCY   0xFU
#define FLASH_ACR_PRFTEN    BIT(8)
#define FLASH_ACR_ICEN      BIT(9)
#define FLASH_ACR_DCEN      BIT(10)
#define FLASH_ACR_ICRST     BIT(11)
#define FLASH_ACR_DCRST     BIT(12)
#define FLASH_KEY1          0x45670123U
#define FLASH_KEY2          0xCDEF89ABU
#define FLASH_SR_ERRORS     (BIT(1) | BIT(4) | BIT(5) | BIT(6) | BIT(7))
#define FLASH_SR_EOP        BIT(0)
#define FLASH_SR_BSY        BIT(16)
#define FLASH_CR_PG         BIT(0)
#define FLASH_CR_SER        BIT(1)
#define FLASH_CR_SNB        3U /* first bit of the sector's number */
#define FLASH_CR_PSIZE_32   (2U << 8U)
#define FLASH_CR_STRT       BIT(16)
#define FLASH_CR_LOCK       BIT(31)
#define FLASH_OPTCR_BOR     (BIT(2) | BIT(3))
#define FLASH_OPTCR_BOR_OFF (BIT(2) | BIT(3))

/* ---- GPIO (RM0090, 8) */
typedef struct {
    reg32 MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
} gpio_registers;

/* ---- USART (RM0090, 30) */
typedef struct {
    reg32 SR, DR, BRR, CR1, CR2, CR3, GTPR;
} usart_registers;
#define USART_SR_FE      BIT(1)
#define USART_SR_NF      BIT(2)
#define USART_SR_ORE     BIT(3)
#define USART_SR_RXNE    BIT(5)
#define USART_SR_TC      BIT(6) /* the last bit is out */
#define USART_SR_TXE     BIT(7)
#define USART_CR1_RE     BIT(2)
#define USART_CR1_TE     BIT(3)
#define USART_CR1_RXNEIE BIT(5)
#define USART_CR1_TXEIE  BIT(7)
#define USART_CR1_UE     BIT(13)

/* ---- SPI (RM0090, 28) */
typedef struct {
    reg32 CR1, CR2, SR, DR, CRCPR, RXCRCR, TXCRCR, I2SCFGR, I2SPR;
} spi_registers;
#define SPI_CR1_CPHA BIT(0)
#define SPI_CR1_CPOL BIT(1)
#define SPI_CR1_MSTR BIT(2)
#define SPI_CR1_BR   3U /* first bit of the clock's divider */
#define SPI_CR1_SPE  BIT(6)
#define SPI_CR1_SSI  BIT(8)
#define SPI_CR1_SSM  BIT(9) /* the chip's select line is a pin of its own */
#define SPI_SR_RXNE  BIT(0)

/* ---- bxCAN (RM0090, 32) */
typedef struct {
    reg32 IR, DTR, DLR, DHR;
} can_mailbox_registers;
typedef struct {
    reg32 MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR, reserved0[88];
    can_mailbox_registers tx[3], rx[2];
    reg32 reserved1[12];
    reg32 FMR, FM1R, reserved2, FS1R, reserved3, FFA1R, reserved4, FA1R, reserved5[8];
    struct {
        reg32 R1, R2;
    } filter[28];
} can_registers;
_Static_assert(offsetof(can_registers, tx) == 0x180, "RM0090, 32.9.5");
_Static_assert(offsetof(can_registers, FMR) == 0x200, "RM0090, 32.9.5");
_Static_assert(offsetof(can_registers, filter) == 0x240, "RM0090, 32.9.5");

#define CAN_MCR_INRQ   BIT(0)
#define CAN_MCR_ABOM   BIT(6)
#define CAN_MSR_INAK   BIT(0)
#define CAN_TSR_RQCP0  BIT(0)
#define CAN_TSR_TXOK0  BIT(1)
#define CAN_TSR_ABRQ0  BIT(7)
#define CAN_TSR_STRIDE 8U /* bits from one mailbox's to the next one's */
#define CAN_TSR_TME0   BIT(26)
#define CAN_RF0R_FMP   3U
#define CAN_RF0R_FOVR  BIT(4)
#define CAN_RF0R_RFOM  BIT(5)
#define CAN_IER_FMPIE0 BIT(1)
#define CAN_ESR_EPVF   BIT(1)
#define CAN_ESR_BOFF   BIT(2)
#define CAN_ESR_LEC    (7U << 4U)
#define CAN_ESR_LEC_AK (3U << 4U) /* nobody acknowledged */
#define CAN_ESR_TEC    16U
#define CAN_ESR_REC    24U
#define CAN_BTR_TS1    16U
#define CAN_BTR_TS2    20U
#define CAN_BTR_SJW    24U
#define CAN_IR_TXRQ    BIT(0)
#define CAN_IR_RTR     BIT(1)
#define CAN_IR_IDE     BIT(2)
#define CAN_IR_STID    21U
#define CAN_FMR_FINIT  BIT(0)

/* ---- TIM1 (RM0090, 17), TIM2 to TIM4 (18): one layout, of which the latter have a part */
typedef struct {
    reg32 CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1, CCR2, CCR3, CCR4, BDTR;
} tim_registers;
_Static_assert(offsetof(tim_registers, BDTR) == 0x44, "RM0090, 17.4.21");
#define TIM_CR1_CEN        BIT(0)
#define TIM_CR1_CENTRE     (BIT(5) | BIT(6)) /* up and down; compare flags both ways */
#define TIM_CR1_ARPE       BIT(7)
#define TIM_CR2_MMS_RESET  0U
#define TIM_CR2_MMS_OC3REF (6U << 4U)
#define TIM_SMCR_RESET     4U /* slave: begin anew at the trigger, ITR0 being TIM1 for TIM2 */
#define TIM_SMCR_ENCODER   3U /* both edges of both inputs */
#define TIM_SR_BIF         BIT(7)
#define TIM_EGR_UG         BIT(0)
#define TIM_CCMR1_PWM      ((6U << 4U) | BIT(3) | (6U << 12U) | BIT(11)) /* channels 1 and 2: PWM 1, preloaded */
#define TIM_CCMR2_PWM3     ((7U << 4U) | BIT(3))                         /* channel 3: PWM 2 */
#define TIM_CCMR1_INPUTS   (BIT(0) | BIT(8) | (3U << 4U) | (3U << 12U))  /* inputs 1 and 2, filter of 8 clocks */
#define TIM_CCER_BRIDGE    (BIT(0) | BIT(2) | BIT(4) | BIT(6))           /* 1, 1N, 2, 2N */
#define TIM_BDTR_LOCK_1    BIT(8) /* dead time and break cannot be changed again until reset */
#define TIM_BDTR_OSSI      BIT(10)
#define TIM_BDTR_OSSR      BIT(11)
#define TIM_BDTR_BKE       BIT(12)
#define TIM_BDTR_BKP       BIT(13)
#define TIM_BDTR_MOE       BIT(15)

/* ---- ADC (RM0090, 13) and its common part, DMA (10) */
typedef struct {
    reg32 SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_registers;
_Static_assert(offsetof(adc_registers, DR) == 0x4C, "RM0090, 13.13.18");
typedef struct {
    reg32 CSR, CCR, CDR;
} adc_common_registers;
#define ADC_SR_OVR         BIT(5)
#define ADC_CR1_SCAN       BIT(8)
#define ADC_CR2_ADON       BIT(0)
#define ADC_CR2_DMA        BIT(8)
#define ADC_CR2_DDS        BIT(9)
#define ADC_CR2_TIM2_TRGO  (6U << 24U)
#define ADC_CR2_RISING     BIT(28)
#define ADC_SMPR_15_CYCLES 1U
#define ADC_CCR_PCLK_BY_4  BIT(16)
typedef struct {
    reg32 CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_registers;
typedef struct {
    reg32 LISR, HISR, LIFCR, HIFCR;
    dma_stream_registers stream[8];
} dma_registers;
#define DMA_LIFCR_STREAM0 0x3DU
#define DMA_CR_EN         BIT(0)
#define DMA_CR_CIRC       BIT(8)
#define DMA_CR_MINC       BIT(10)
#define DMA_CR_HALFWORDS  (BIT(11) | BIT(13))

/* ---- IWDG: independent watchdog (RM0090, 21) */
typedef struct {
    reg32 KR, PR, RLR, SR;
} iwdg_registers;
#define IWDG_KR_RELOAD 0xAAAAU
#define IWDG_KR_ACCESS 0x5555U
#define IWDG_KR_START  0xCCCCU

/* ---- The core: system control, SysTick, NVIC, MPU, cycle counter (Arm DDI 0403, B3) */
typedef struct {
    reg32 CTRL, LOAD, VAL, CALIB;
} systick_registers;
#define SYSTICK_ENABLE  BIT(0)
#define SYSTICK_TICKINT BIT(1)
#define SYSTICK_CORE    BIT(2)
typedef struct {
    reg32 CPUID, ICSR, VTOR, AIRCR, SCR, CCR, SHPR[3], SHCSR, CFSR, HFSR, DFSR, MMFAR, BFAR, AFSR;
} scb_registers;
#define SCB_ICSR_PENDSTCLR BIT(25)
#define SCB_AIRCR_RESET    (0x05FA0000U | BIT(2))
#define SCB_CFSR_MMARVALID BIT(7)
#define SCB_CFSR_PRECISE   BIT(9)
typedef struct {
    reg32 TYPE, CTRL, RNR, RBAR, RASR;
} mpu_registers;
#define MPU_CTRL_ENABLE     BIT(0)
#define MPU_CTRL_PRIVDEFENA BIT(2)
#define MPU_RASR_NO_ACCESS  BIT(28) /* never executed; access permission 0: none */
#define MPU_RASR_32_BYTES   (4U << 1U)
#define MPU_RASR_ENABLE     BIT(0)
typedef struct {
    reg32 CTRL, CYCCNT;
} dwt_registers;
#define DWT_CTRL_CYCCNTENA BIT(0)

#define RCC          ((rcc_registers *)0x40023800U)
#define PWR          ((pwr_registers *)0x40007000U)
#define FLASH        ((flash_registers *)0x40023C00U)
#define GPIO(port)   ((gpio_registers *)(0x40020000U + (0x400U * (port)))) /* 0 is A */
#define USART1       ((usart_registers *)0x40011000U)
#define SPI1         ((spi_registers *)0x40013000U)
#define CAN1         ((can_registers *)0x40006400U)
#define TIM1         ((tim_registers *)0x40010000U)
#define TIM2         ((tim_registers *)0x40000000U)
#define TIM3         ((tim_registers *)0x40000400U)
#define TIM4         ((tim_registers *)0x40000800U)
#define ADC1         ((adc_registers *)0x40012000U)
#define ADC_COMMON   ((adc_common_registers *)0x40012300U)
#define DMA2         ((dma_registers *)0x40026400U)
#define IWDG         ((iwdg_registers *)0x40003000U)
#define SYSTICK      ((systick_registers *)0xE000E010U)
#define NVIC_ISER    ((reg32 *)0xE000E100U)
#define NVIC_ICER    ((reg32 *)0xE000E180U)
#define NVIC_ICPR    ((reg32 *)0xE000E280U)
#define SCB          ((scb_registers *)0xE000ED00U)
#define MPU          ((mpu_registers *)0xE000ED90U)
#define DEMCR        (*(reg32 *)0xE000EDFCU)
#define DEMCR_TRCENA BIT(24)
#define DWT          ((dwt_registers *)0xE0001000U)
#define DBGMCU_CR    (*(reg32 *)0xE0042004U)
#define DBGMCU_SLEEP BIT(0) /* the core's clock goes on in sleep, RM0090, 38.16.1 */
#define RNG          ((rng_registers *)0x50060800U)
#define RNG_STATUS   0x50060804U
#define FLASH_MEMORY 0x08000000U
#define UNIQUE_ID    0x1FFF7A10U /* three words, RM0090, 39.1 */

#define IRQ_CAN1_RX0 20U
#define IRQ_USART1   37U
#define IRQ_COUNT    82U

#endif
