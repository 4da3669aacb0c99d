/* What is there before main: memory, floating point, a stack that shows how deep it was used. */
#ifndef SMPC_STARTUP_H
#define SMPC_STARTUP_H

/* Bytes of the stack that were ever used, from its top to the deepest word that has changed. */
unsigned long smpc_stack_used(void);

/* Cycles of the processor modulo 2^24, by SysTick. */
unsigned long smpc_cycles(void);

#endif
