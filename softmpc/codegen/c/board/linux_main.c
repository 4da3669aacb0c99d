/* Recorded steps from standard input, answers to standard output: for any system with files. */
#include <stdio.h>

#include "steps.h"

long smpc_read(void *buffer, unsigned long bytes)
{
    return (long)fread(buffer, 1, bytes, stdin);
}

int smpc_write(const void *buffer, unsigned long bytes)
{
    return fwrite(buffer, 1, bytes, stdout) == bytes ? 0 : -1;
}

unsigned long smpc_ticks(void)
{
    return 0; /* no clock: nothing is measured */
}

int main(void)
{
    smpc_tally tally;
    int failed = smpc_run_steps(&tally);

    if (fflush(stdout)) failed = -1;
    fprintf(stderr, "steps %lu\ncontroller_bytes %lu\n", tally.steps,
            (unsigned long)sizeof(smpc_controller));
    return failed ? 1 : 0;
}
