/* track-cpu: follows one object through video on a CPU.
 *
 *     track_cpu_tracker *tracker;
 *     if (track_cpu_create(NULL, 1, &tracker) != TRACK_CPU_OK) {
 *         puts(track_cpu_last_error());
 *         return 1;
 *     }
 *     track_cpu_image image = {pixels, 640, 360, 0, TRACK_CPU_BGR};
 *     track_cpu_box box = {300, 120, 40, 24};
 *     track_cpu_init(tracker, &image, &box);
 *     while (next(&image)) track_cpu_update(tracker, &image, &box);
 *     track_cpu_destroy(tracker);
 *
 * `cargo build --release -p capi` makes target/release/libtrack_cpu_c.so (.dylib, track_cpu_c.dll).
 *
 * Each function that returns an int32_t returns one of the codes below; track_cpu_last_error() says
 * what was expected and found. Several threads may call functions on one tracker: the calls wait
 * for each other. After fork() a tracker of several threads returns TRACK_CPU_FORKED in the child;
 * make a new one there. No picture is kept after a call. */

#ifndef TRACK_CPU_H
#define TRACK_CPU_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TRACK_CPU_OK = 0,
    TRACK_CPU_ARGUMENT = 1, /* a pointer is null, or a number is none of those allowed */
    TRACK_CPU_MODEL = 2,    /* the weights file cannot be used */
    TRACK_CPU_IMAGE = 3,    /* the picture is invalid: a side is 0 or above 32768, or the stride is
                               shorter than a row */
    TRACK_CPU_TARGET = 4,   /* the box has no area or lies outside the picture, or there is no
                               target yet */
    TRACK_CPU_DEFECT = 5,   /* a defect of the library; destroy the tracker */
    TRACK_CPU_FORKED = 6    /* the process was forked after this tracker had started its threads */
};

enum {
    TRACK_CPU_BGR = 0, /* three bytes a pixel, as OpenCV has them */
    TRACK_CPU_RGB = 1,
    TRACK_CPU_BGRA = 2, /* four bytes a pixel, the last one ignored */
    TRACK_CPU_RGBA = 3,
    TRACK_CPU_GRAY = 4 /* one byte a pixel */
};

typedef struct track_cpu_tracker track_cpu_tracker;

/* A picture that the caller keeps: rows from the top, pixels from the left. */
typedef struct track_cpu_image {
    const uint8_t *data;
    uint32_t width, height; /* pixels */
    size_t stride;          /* bytes from one row to the next; 0 if there is no gap between them */
    uint32_t format;        /* TRACK_CPU_BGR ... TRACK_CPU_GRAY */
} track_cpu_image;

/* A box in pixels: left, top, width, height. A box of one pixel at (3, 4) is {3, 4, 1, 1}. */
typedef struct track_cpu_box {
    float x, y, w, h;
} track_cpu_box;

/* Makes a tracker from a weights file (UTF-8 path) or the built-in model of that name, or from the
 * standard model if NULL. 1 to 256 threads work on one frame. *out is NULL on failure. */
int32_t track_cpu_create(const char *model_path, uint32_t threads, track_cpu_tracker **out);

/* Takes the content of the box as the new target. On failure the old target stays. */
int32_t track_cpu_init(track_cpu_tracker *tracker, const track_cpu_image *image, const track_cpu_box *target);

/* Finds the target in the next picture, which may have another size. */
int32_t track_cpu_update(track_cpu_tracker *tracker, const track_cpu_image *image, track_cpu_box *out);

/* How sure the tracker is of the last box, from 0 to 1, as OpenCV's getTrackingScore(); 1 after
 * track_cpu_init. */
int32_t track_cpu_score(const track_cpu_tracker *tracker, float *out);

/* Flight mode: says how sure it is, coasts while the target is hidden, finds it again. All of the
 * functions above work on such a tracker, too; its track_cpu_score() is the presence.
 *
 * The defaults (track_cpu_flight_defaults) hold for all models, since presence is a calibrated
 * probability. Act on a box only if `believed` is 1: the target is seen (not predicted) and its
 * presence is at least 0.4. */
typedef struct track_cpu_flight_options {
    double present;  /* 0.5: least presence of a target that counts as seen; below it the state is
                        LOW_CONFIDENCE */
    double sure;     /* 0.8: least presence at which its motion is kept for later searches, and
                        other objects beside it are remembered as look-alikes */
    double absent;   /* 0.01: presence below which an empty look counts as absence */
    double patience; /* 0.5: seconds of absence before the box is given up: COASTING */
    double coast;    /* 1: seconds of COASTING before the target is LOST */
    double fps;      /* 30: pictures per second where track_cpu_update_flight is told no time */
    uint32_t confirm;   /* 3: looks in a row, one a picture, that confirm a lost target's place */
    uint32_t tell_only; /* 0; with 1 no box is given up or searched for: only presence tells */
} track_cpu_flight_options;

enum {
    TRACK_CPU_TRACKING = 0,       /* the box is on the target */
    TRACK_CPU_LOW_CONFIDENCE = 1, /* the box may be on the target */
    TRACK_CPU_COASTING = 2,       /* the target is hidden; the box is predicted */
    TRACK_CPU_LOST = 3,           /* the target is searched for; the box is where it would be */
    TRACK_CPU_REACQUIRED = 4      /* the target was found again a moment ago */
};

/* Where the target is in one picture. */
typedef struct track_cpu_flight_track {
    track_cpu_box box;
    float score;       /* raw score of the last search; no probability */
    float presence;    /* probability that the box is on the target, 0 to 1 */
    uint32_t state;    /* TRACK_CPU_TRACKING ... TRACK_CPU_REACQUIRED */
    uint32_t believed; /* 1 if the box is worth acting on */
    uint32_t searches; /* made for this picture */
} track_cpu_flight_track;

/* A place where the target may be. */
typedef struct track_cpu_candidate {
    track_cpu_box box;
    float score;      /* 0 to 1 */
    float similarity; /* cosine of its features with the target's, -1 to 1 */
} track_cpu_candidate;

/* Writes the default options. */
int32_t track_cpu_flight_defaults(track_cpu_flight_options *out);

/* Makes a tracker in flight mode, as track_cpu_create does; options may be NULL. */
int32_t track_cpu_create_flight(const char *model_path, uint32_t threads,
                                const track_cpu_flight_options *options, track_cpu_tracker **out);

/* Finds the target in the next picture, taken `elapsed` seconds after the one before (0: 1 / fps).
 * The search for a target that is not seen takes at most `deadline` seconds, but makes at least one
 * attempt; with 0 it makes two, the same on every machine. */
int32_t track_cpu_update_flight(track_cpu_tracker *tracker, const track_cpu_image *image,
                                double elapsed, double deadline, track_cpu_flight_track *out);

/* Writes up to `capacity` places that the last search found, the chosen one first, and their
 * number: at most 5. */
int32_t track_cpu_candidates(const track_cpu_tracker *tracker, track_cpu_candidate *candidates,
                             uint32_t capacity, uint32_t *count);

/* Ends a tracker, which no other thread may be using; a no-op for NULL. */
void track_cpu_destroy(track_cpu_tracker *tracker);

/* Describes the last failure on this thread. Never NULL; lasts until the next call there. */
const char *track_cpu_last_error(void);

/* The library's version, such as "0.1.0". */
const char *track_cpu_version(void);

#ifdef __cplusplus
}
#endif

#endif
