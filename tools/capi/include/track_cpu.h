/* track-cpu: follows one object through video on a CPU. Version 1.0 of the C interface.
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
 * `tools/capi/install.sh PREFIX` installs the library, this header, track_cpu.hpp for C++, and
 * files for pkg-config and CMake. Then:
 *
 *     cc follow.c $(pkg-config --cflags --libs track_cpu)
 *     find_package(track_cpu 1.0 REQUIRED), target_link_libraries(follow track_cpu::track_cpu)
 *
 * Each function that returns an int32_t returns one of the codes below; each comment names those
 * that its function may return besides TRACK_CPU_OK and TRACK_CPU_DEFECT.
 * track_cpu_last_error() says what was expected and found. A null pointer is TRACK_CPU_ARGUMENT
 * unless the comment allows it. Outputs are written only on success, if nothing else is said.
 *
 * Several threads may call functions on one tracker: the calls wait for each other. After fork() a
 * tracker of several threads returns TRACK_CPU_FORKED in the child, where it can only be destroyed;
 * make a new one there. No picture is kept after a call.
 *
 * Programs built with this header run with every later library of version 1. */

#ifndef TRACK_CPU_H
#define TRACK_CPU_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TRACK_CPU_VERSION_MAJOR 1
#define TRACK_CPU_VERSION_MINOR 0

enum {
    TRACK_CPU_OK = 0,
    TRACK_CPU_ARGUMENT = 1, /* a pointer is null, or a number is none of those allowed */
    TRACK_CPU_MODEL = 2,    /* the weights file cannot be used */
    TRACK_CPU_IMAGE = 3,    /* the picture is invalid: a side is 0 or above 32768, or the stride is
                               shorter than a row */
    TRACK_CPU_TARGET = 4,   /* the box has no area, lies outside the picture or is in shares of its
                               sides (0 to 1), or there is no target yet */
    TRACK_CPU_DEFECT = 5,   /* a defect of the library; destroy the tracker */
    TRACK_CPU_FORKED = 6    /* the process was forked after this tracker had started its threads */
};

enum {
    TRACK_CPU_BGR = 0, /* three bytes a pixel, as OpenCV has them */
    TRACK_CPU_RGB = 1,
    TRACK_CPU_BGRA = 2, /* four bytes a pixel, the last one ignored */
    TRACK_CPU_RGBA = 3,
    TRACK_CPU_GRAY = 4, /* one byte a pixel */
    /* YUV as cameras and decoders have it (BT.601, limited range). Only the pixels that are looked
     * at are converted. Planes follow each other: rows of half the width take half the stride,
     * and a half is rounded up. */
    TRACK_CPU_NV12 = 5, /* a plane of Y, then one of U and V by turns for every 2 x 2 pixels */
    TRACK_CPU_NV21 = 6, /* the same with V before U */
    TRACK_CPU_I420 = 7, /* planes of Y, U and V */
    TRACK_CPU_YUYV = 8, /* Y U Y V for every two pixels of a row */
    TRACK_CPU_UYVY = 9  /* U Y V Y for every two pixels of a row */
};

/* Arithmetic of the network. */
enum {
    TRACK_CPU_FASTEST = 0, /* int8 where the model is calibrated, else f32 */
    TRACK_CPU_F32 = 1,
    TRACK_CPU_INT8 = 2
};

/* Weights, immutable: trackers on any threads share them. */
typedef struct track_cpu_model track_cpu_model;

/* A target that is followed, with the buffers and threads for it. */
typedef struct track_cpu_tracker track_cpu_tracker;

/* A picture that the caller keeps: rows from the top, pixels from the left. */
typedef struct track_cpu_image {
    const uint8_t *data;    /* rows of `width` pixels, stride * height bytes a plane; the last row
                               may end after its pixels */
    uint32_t width, height; /* pixels, 1 to 32768 */
    size_t stride;          /* bytes from one row to the next in the first plane; 0 if there is no
                               gap between them */
    uint32_t format;        /* TRACK_CPU_BGR ... TRACK_CPU_UYVY */
} track_cpu_image;

/* A box in pixels: left, top, width, height. A box of one pixel at (3, 4) is {3, 4, 1, 1}. */
typedef struct track_cpu_box {
    float x, y, w, h;
} track_cpu_box;

/* Loads a weights file (UTF-8 path) or the built-in model of that name; NULL means the standard
 * model. `precision` is TRACK_CPU_FASTEST, TRACK_CPU_F32 or TRACK_CPU_INT8. *out is NULL on
 * failure. Errors: ARGUMENT; MODEL: no such file or model, not a weights file, or INT8 without
 * calibration. */
int32_t track_cpu_model_load(const char *model_path, uint32_t precision, track_cpu_model **out);

/* Destroys a model; does nothing for NULL. Trackers that share it keep working. */
void track_cpu_model_destroy(track_cpu_model *model);

/* Makes a tracker from a weights file or built-in model, as track_cpu_model_load() names it, in the
 * faster precision. 1 to 256 threads work on one frame. *out is NULL on failure.
 * Errors: ARGUMENT: the number of threads; MODEL. */
int32_t track_cpu_create(const char *model_path, uint32_t threads, track_cpu_tracker **out);

/* Makes a tracker from a model, which it shares. Errors: ARGUMENT. */
int32_t track_cpu_create_from(const track_cpu_model *model, uint32_t threads,
                              track_cpu_tracker **out);

/* Takes the content of the box (pixels) as the new target. On failure the old target stays.
 * Errors: ARGUMENT: the format; IMAGE; TARGET: a number is not finite, or the box has no area or no
 * pixel of the picture, or is in shares of its sides; FORKED. */
int32_t track_cpu_init(track_cpu_tracker *tracker, const track_cpu_image *image,
                       const track_cpu_box *target);

/* Finds the target in the next picture, which may have another size: its box in pixels.
 * Errors: ARGUMENT: the format; IMAGE; TARGET: there is none yet; FORKED. */
int32_t track_cpu_update(track_cpu_tracker *tracker, const track_cpu_image *image,
                         track_cpu_box *out);

/* How sure the tracker is of the last box, from 0 to 1, as OpenCV's getTrackingScore(); 1 after
 * track_cpu_init(), 0 before it. Errors: ARGUMENT, FORKED. */
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
    double fps;      /* 30: pictures per second where track_cpu_update_flight is told no time, 0.1
                        to 1000 */
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

/* Writes the default options. Errors: ARGUMENT. */
int32_t track_cpu_flight_defaults(track_cpu_flight_options *out);

/* Makes a tracker in flight mode, as track_cpu_create() does; options may be NULL.
 * Errors: ARGUMENT: the number of threads, an option; MODEL. */
int32_t track_cpu_create_flight(const char *model_path, uint32_t threads,
                                const track_cpu_flight_options *options, track_cpu_tracker **out);

/* Makes a tracker in flight mode from a model, which it shares; options may be NULL.
 * Errors: ARGUMENT: the number of threads, an option; MODEL: the model's presence coefficients. */
int32_t track_cpu_create_flight_from(const track_cpu_model *model, uint32_t threads,
                                     const track_cpu_flight_options *options,
                                     track_cpu_tracker **out);

/* Finds the target in the next picture, taken `elapsed` seconds after the one before (0: 1 / fps).
 * The search for a target that is not seen takes at most `deadline` seconds, but makes at least one
 * attempt; with 0 it makes two, the same on every machine.
 * Errors: ARGUMENT: the format, negative seconds, or a tracker that is not in flight mode; IMAGE;
 * TARGET: there is none yet; FORKED. */
int32_t track_cpu_update_flight(track_cpu_tracker *tracker, const track_cpu_image *image,
                                double elapsed, double deadline, track_cpu_flight_track *out);

/* Writes up to `capacity` places that the last search found, the chosen one first, and the number
 * of places written: at most 5.
 * Errors: ARGUMENT: also a tracker that is not in flight mode; FORKED. */
int32_t track_cpu_candidates(const track_cpu_tracker *tracker, track_cpu_candidate *candidates,
                             uint32_t capacity, uint32_t *count);

/* Ends a tracker, which no other thread may be using; a no-op for NULL. */
void track_cpu_destroy(track_cpu_tracker *tracker);

/* Describes this thread's last failure in UTF-8. Never NULL; lasts until the next call there. */
const char *track_cpu_last_error(void);

/* The library's version, such as "1.0.0". */
const char *track_cpu_version(void);

#ifdef __cplusplus
}
#endif

#endif
