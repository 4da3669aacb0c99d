/* Start of a Cortex-M7: vectors, memory, floating point, painted stack; then main. */
#include "startup.h"

#include <stdint.h>

#include "semihosting.h"

#define CPACR (*(volatile uint32_t *)0xE000ED88UL) /* who may use the floating point unit */
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010UL)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014UL)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018UL)
#define FULL_ACCESS_TO_10_AND_11 (0xFUL << 20)
#define ON_BY_PROCESSOR_CLOCK 5UL
#define LARGEST_COUNT 0xFFFFFFUL
#define PAINT 0xA5C3965AUL

extern uint32_t smpc_data_source[], smpc_data_start[], smpc_data_end[];
extern uint32_t smpc_bss_start[], smpc_bss_end[];
extern uint32_t smpc_stack_bottom[], smpc_stack_top[]; /* of the linker script */

int main(void);
void smpc_reset(void);
void smpc_fault(void);

/* The processor reads its stack pointer and its first instruction here. */
__attribute__((section(".vectors"), used)) static const uintptr_t vectors[16] = {
    (uintptr_t)smpc_stack_top, (uintptr_t)smpc_reset, (uintptr_t)smpc_fault, (uintptr_t)smpc_fault,
    (uintptr_t)smpc_fault,     (uintptr_t)smpc_fault, (uintptr_t)smpc_fault, 0, 0, 0, 0,
    (uintptr_t)smpc_fault,     (uintptr_t)smpc_fault, 0, (uintptr_t)smpc_fault,
    (uintptr_t)smpc_fault};

/* Below the stack pointer nothing is in use yet. */
static void paint_stack(void)
{
    uint32_t *end;
    __asm__ volatile("mov %0, sp" : "=r"(end));
    for (uint32_t *word = smpc_stack_bottom; word < end; word++) *word = PAINT;
}

static void start_clock(void)
{
    SYSTICK_RELOAD = LARGEST_COUNT;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = ON_BY_PROCESSOR_CLOCK;
}

void smpc_reset(void)
{
    const uint32_t *from = smpc_data_source;

    CPACR |= FULL_ACCESS_TO_10_AND_11;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    for (uint32_t *to = smpc_data_start; to < smpc_data_end; to++) *to = *from++;
    for (uint32_t *to = smpc_bss_start; to < smpc_bss_end; to++) *to = 0;
    paint_stack();
    start_clock();
    smpc_exit(main());
}

void smpc_fault(void)
{
    smpc_say("fault", 1);
    smpc_exit(70);
}

unsigned long smpc_stack_used(void)
{
    const uint32_t *word = smpc_stack_bottom;
    while (word < smpc_stack_top && *word == PAINT) word++;
    return (unsigned long)(smpc_stack_top - word) * sizeof *word;
}

unsigned long smpc_cycles(void)
{
    return LARGEST_COUNT - SYSTICK_VALUE; /* it counts down */
}
