/* A ring of the latest records, see recorder.h. It always holds whole records, also where power or
 * program end in the middle of one: that one is in nobody's count until its last byte is there. */
#include "recorder.h"

#include <string.h>

enum { FRAME = 8, CRC = 4, LENGTH_AT = 4 };

void smpc_ring_init(smpc_ring *ring, unsigned char *bytes, size_t size)
{
    memset(ring, 0, sizeof *ring);
    ring->bytes = bytes;
    ring->size = size;
}

static size_t length_in(const unsigned char *frame)
{
    size_t length = 0;
    for (int i = 3; i >= 0; i--) {
        length = length << 8 | frame[LENGTH_AT + i];
    }
    return FRAME + length + CRC;
}

/* Index of a byte, counted from the oldest record. */
static size_t at(const smpc_ring *ring, size_t offset)
{
    size_t i = ring->first + offset;
    return i < ring->size ? i : i - ring->size;
}

static void drop_oldest(smpc_ring *ring)
{
    unsigned char frame[FRAME];
    size_t length;
    for (size_t i = 0; i < FRAME; i++) {
        frame[i] = ring->bytes[at(ring, i)];
    }
    length = length_in(frame);
    ring->first = at(ring, length);
    ring->used -= length;
    ring->lost++;
}

/* A record of this length is coming. */
static void make_room(smpc_ring *ring, size_t whole)
{
    ring->whole = whole;
    ring->dropped = whole > ring->size;
    if (ring->dropped) {
        ring->lost++;
    }
    while (!ring->dropped && ring->used + whole > ring->size) {
        drop_oldest(ring);
    }
}

void smpc_ring_write(void *with, const unsigned char *bytes, size_t count)
{
    smpc_ring *ring = with;
    if (!ring->done) {
        make_room(ring, length_in(bytes));
    }
    for (size_t i = 0; i < count && !ring->dropped; i++) {
        ring->bytes[at(ring, ring->used + ring->done + i)] = bytes[i];
    }
    ring->done += count;
    if (ring->done == ring->whole) {
        ring->used += ring->dropped ? 0 : ring->whole;
        ring->done = 0;
    }
}

void smpc_ring_dump(const smpc_ring *ring, smpc_sink write, void *with)
{
    size_t to_end = ring->size - ring->first;
    size_t piece = ring->used < to_end ? ring->used : to_end;
    write(with, ring->bytes + ring->first, piece);
    if (piece < ring->used) {
        write(with, ring->bytes, ring->used - piece);
    }
}
