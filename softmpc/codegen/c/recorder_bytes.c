/* Numbers of a flight log byte by byte, the lowest first, so that logs of all machines are the same. */
#include "recorder_bytes.h"

#include <string.h>

enum { FRAME = 8, CRC = 4 };

/* CRC-32 as of zlib, four bits at a time: a small table is enough for a record a step. */
static uint32_t crc_of(uint32_t crc, const unsigned char *bytes, size_t count)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u,
        0x4db26158u, 0x5005713cu, 0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
        0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
    };
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return crc;
}

void smpc_put(smpc_recorder *r, const unsigned char *bytes, size_t count)
{
    r->crc = crc_of(r->crc, bytes, count);
    r->write(r->with, bytes, count);
}

static void lowest_first(unsigned char *bytes, uint64_t value, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        bytes[i] = (unsigned char)(value >> (8 * i) & 0xffu);
    }
}

void smpc_put_whole(smpc_recorder *r, uint64_t value, size_t count)
{
    unsigned char bytes[8];
    lowest_first(bytes, value, count);
    smpc_put(r, bytes, count);
}

void smpc_put_double(smpc_recorder *r, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    smpc_put_whole(r, bits, 8);
}

void smpc_put_float(smpc_recorder *r, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    smpc_put_whole(r, bits, 4);
}

void smpc_put_reals(smpc_recorder *r, const smpc_real *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
#ifdef SMPC_FLOAT
        smpc_put_float(r, values[i]);
#else
        smpc_put_double(r, values[i]);
#endif
    }
}

void smpc_put_text(smpc_recorder *r, const char *text)
{
    size_t count = strlen(text);
    count = count > 255 ? 255 : count;
    smpc_put_whole(r, count, 1);
    smpc_put(r, (const unsigned char *)text, count);
}

void smpc_begin(smpc_recorder *r, int kind, size_t length)
{
    unsigned char frame[FRAME] = {'F', 'R', 0, 0, 0, 0, 0, 0};
    frame[2] = (unsigned char)kind;
    lowest_first(frame + 4, length, 4);
    r->crc = 0xffffffffu;
    smpc_put(r, frame, FRAME);
}

void smpc_end(smpc_recorder *r)
{
    smpc_put_whole(r, r->crc ^ 0xffffffffu, CRC);
}
