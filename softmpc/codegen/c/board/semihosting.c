/* Semihosting calls: an operation in r0, a block of arguments in r1, and a breakpoint that the
 * debugger or emulator takes for a call. See "Semihosting for AArch32 and AArch64" by Arm. */
#include "semihosting.h"

enum { OPEN = 0x01, CLOSE = 0x02, WRITE0 = 0x04, WRITE = 0x05, READ = 0x06, EXIT_WITH_CODE = 0x20 };

#define APPLICATION_EXIT 0x20026UL

static unsigned long call(unsigned long operation, const void *arguments)
{
    register unsigned long r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;

    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static unsigned long length(const char *text)
{
    unsigned long n = 0;
    while (text[n]) n++;
    return n;
}

int smpc_open(const char *name, int mode)
{
    unsigned long block[3] = {(unsigned long)name, (unsigned long)mode, length(name)};
    return (int)call(OPEN, block);
}

unsigned long smpc_file_read(int handle, void *buffer, unsigned long bytes)
{
    unsigned long block[3] = {(unsigned long)handle, (unsigned long)buffer, bytes};
    return call(READ, block);
}

unsigned long smpc_file_write(int handle, const void *buffer, unsigned long bytes)
{
    unsigned long block[3] = {(unsigned long)handle, (unsigned long)buffer, bytes};
    return call(WRITE, block);
}

int smpc_close(int handle)
{
    unsigned long block[1] = {(unsigned long)handle};
    return (int)call(CLOSE, block);
}

void smpc_say(const char *name, unsigned long long value)
{
    char digits[22];
    int at = (int)sizeof digits;

    digits[--at] = '\0';
    digits[--at] = '\n';
    do {
        digits[--at] = (char)('0' + value % 10);
        value /= 10;
    } while (value);
    call(WRITE0, name);
    call(WRITE0, " ");
    call(WRITE0, digits + at);
}

void smpc_exit(int code)
{
    unsigned long block[2] = {APPLICATION_EXIT, (unsigned long)code};

    call(EXIT_WITH_CODE, block);
    for (;;) continue; /* nobody listens */
}
