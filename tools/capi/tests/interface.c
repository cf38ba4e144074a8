/* Calls every function of track_cpu.h as a careful and as a careless program would; prints
 * "passed". Made to run under the address sanitizer, which reports wrong frees and leaks. */

#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include <track_cpu.h>

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#define WIDTH 96
#define HEIGHT 64

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "line %d: %s: %s\n", __LINE__, #condition, track_cpu_last_error());    \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

/* A picture whose last byte is the last one before a page that cannot be read: the library is not
 * compiled with the sanitizer, so that only this page detects a read past the picture. */
struct picture {
    uint8_t *pixels;
    void *pages;
    size_t length;
};

/* With `behind` bytes of chroma behind the first plane. */
static struct picture yuv(int shift, int channels, size_t stride, size_t behind) {
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    size_t bytes = (HEIGHT - 1) * stride + (behind ? stride + behind : (size_t)WIDTH * channels);
    size_t readable = (bytes + page - 1) / page * page;
    struct picture made = {NULL, NULL, readable + page};
    int access = PROT_READ | PROT_WRITE;
    made.pages = mmap(NULL, made.length, access, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    CHECK(made.pages != MAP_FAILED);
    CHECK(mprotect((uint8_t *)made.pages + readable, page, PROT_NONE) == 0);
    made.pixels = (uint8_t *)made.pages + readable - bytes;
    memset(made.pixels, 128, bytes);
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            int inside = x >= 24 + shift && x < 40 + shift && y >= 24 && y < 40;
            int gray = inside ? 230 : (x * 7 + y * 13) % 60;
            memset(made.pixels + y * stride + x * channels, gray, channels);
        }
    }
    return made;
}

static struct picture picture(int shift, int channels, size_t stride) {
    return yuv(shift, channels, stride, 0);
}

static void release(struct picture *made) { CHECK(munmap(made->pages, made->length) == 0); }

static const track_cpu_box target = {24, 24, 16, 16};

static void formats_and_strides_are_read_within_their_bytes(void) {
    track_cpu_tracker *tracker;
    CHECK(track_cpu_create("drmim-p75", 1, &tracker) == TRACK_CPU_OK);
    const int channels[] = {3, 3, 4, 4, 1, 1, 1, 1, 2, 2};
    for (uint32_t format = TRACK_CPU_BGR; format <= TRACK_CPU_UYVY; format++) {
        for (size_t gap = 0; gap < 20; gap += 7) {
            size_t stride = WIDTH * channels[format] + gap;
            size_t half = (stride + 1) / 2; /* the stride of planes of half the width */
            size_t behind = 0;
            if (format == TRACK_CPU_NV12 || format == TRACK_CPU_NV21) {
                behind = (HEIGHT / 2 - 1) * stride + WIDTH;
            } else if (format == TRACK_CPU_I420) {
                behind = (HEIGHT - 1) * half + WIDTH / 2;
            }
            struct picture made = yuv(0, channels[format], stride, behind);
            track_cpu_image image = {made.pixels, WIDTH, HEIGHT, gap ? stride : 0, format};
            track_cpu_box box = {0, 0, 0, 0};
            float score = -1;
            CHECK(track_cpu_init(tracker, &image, &target) == TRACK_CPU_OK);
            CHECK(track_cpu_update(tracker, &image, &box) == TRACK_CPU_OK);
            CHECK(track_cpu_score(tracker, &score) == TRACK_CPU_OK);
            CHECK(box.w > 0 && box.h > 0 && score >= 0 && score <= 1);
            release(&made);
        }
    }
    track_cpu_destroy(tracker);
}

static void bad_arguments_give_codes_and_write_nothing(void) {
    track_cpu_model *model = (track_cpu_model *)1;
    track_cpu_tracker *tracker = (track_cpu_tracker *)1;
    CHECK(track_cpu_model_load("/nonexistent", 0, &model) == TRACK_CPU_MODEL && !model);
    CHECK(track_cpu_model_load(NULL, 3, &model) == TRACK_CPU_ARGUMENT && !model);
    CHECK(strstr(track_cpu_last_error(), "precision is 3"));
    CHECK(track_cpu_model_load(NULL, 0, NULL) == TRACK_CPU_ARGUMENT);
    CHECK(track_cpu_create_from(NULL, 1, &tracker) == TRACK_CPU_ARGUMENT && !tracker);
    CHECK(track_cpu_create(NULL, 257, &tracker) == TRACK_CPU_ARGUMENT && !tracker);

    CHECK(track_cpu_create("drmim-p75", 1, &tracker) == TRACK_CPU_OK);
    struct picture made = picture(0, 3, WIDTH * 3);
    track_cpu_image image = {made.pixels, WIDTH, HEIGHT, 0, TRACK_CPU_RGB};
    track_cpu_box box = {1, 2, 3, 4};
    track_cpu_flight_track track;
    CHECK(track_cpu_update(tracker, &image, &box) == TRACK_CPU_TARGET);
    CHECK(box.x == 1 && box.y == 2 && box.w == 3 && box.h == 4);
    CHECK(track_cpu_update_flight(tracker, &image, 0, 0, &track) == TRACK_CPU_ARGUMENT);
    const track_cpu_box shares = {0.25f, 0.375f, 0.2f, 0.25f};
    CHECK(track_cpu_init(tracker, &image, &shares) == TRACK_CPU_TARGET);
    CHECK(strstr(track_cpu_last_error(), "expected pixels, found shares of the frame"));
    image.stride = WIDTH * 3 - 1;
    CHECK(track_cpu_init(tracker, &image, &target) == TRACK_CPU_IMAGE);
    image.stride = 0;
    image.width = 70000;
    CHECK(track_cpu_init(tracker, &image, &target) == TRACK_CPU_IMAGE);
    release(&made);
    track_cpu_destroy(tracker);
    track_cpu_destroy(NULL);
    track_cpu_model_destroy(NULL);
}

static void trackers_outlive_the_model_they_share(void) {
    track_cpu_model *model;
    track_cpu_tracker *trackers[2];
    track_cpu_box boxes[2];
    CHECK(track_cpu_model_load("drmim-p75", TRACK_CPU_F32, &model) == TRACK_CPU_OK);
    for (int i = 0; i < 2; i++) {
        CHECK(track_cpu_create_from(model, 1, &trackers[i]) == TRACK_CPU_OK);
    }
    track_cpu_model_destroy(model);
    struct picture made = picture(0, 1, WIDTH);
    track_cpu_image image = {made.pixels, WIDTH, HEIGHT, 0, TRACK_CPU_GRAY};
    for (int i = 0; i < 2; i++) {
        CHECK(track_cpu_init(trackers[i], &image, &target) == TRACK_CPU_OK);
        CHECK(track_cpu_update(trackers[i], &image, &boxes[i]) == TRACK_CPU_OK);
        track_cpu_destroy(trackers[i]);
    }
    CHECK(memcmp(&boxes[0], &boxes[1], sizeof boxes[0]) == 0);
    release(&made);
}

static void flight_mode_fills_its_structs(void) {
    track_cpu_flight_options options;
    track_cpu_tracker *tracker;
    track_cpu_flight_track track;
    track_cpu_candidate *places = malloc(2 * sizeof *places);
    uint32_t count = 9;
    CHECK(track_cpu_flight_defaults(&options) == TRACK_CPU_OK && options.confirm == 3);
    options.coast = 2;
    CHECK(track_cpu_create_flight("drmim-p75", 1, &options, &tracker) == TRACK_CPU_OK);
    for (int i = 0; i < 3; i++) {
        struct picture made = picture(2 * i, 1, WIDTH);
        track_cpu_image image = {made.pixels, WIDTH, HEIGHT, 0, TRACK_CPU_GRAY};
        if (i == 0) {
            CHECK(track_cpu_init(tracker, &image, &target) == TRACK_CPU_OK);
        } else {
            CHECK(track_cpu_update_flight(tracker, &image, 0.04, 0.03, &track) == TRACK_CPU_OK);
            CHECK(track.presence >= 0 && track.presence <= 1 && track.searches >= 1);
            CHECK(track.state <= TRACK_CPU_REACQUIRED && track.believed <= 1);
        }
        release(&made);
    }
    CHECK(track_cpu_candidates(tracker, places, 2, &count) == TRACK_CPU_OK && count <= 2);
    free(places);
    track_cpu_destroy(tracker);
}

struct work {
    track_cpu_tracker *tracker;
    track_cpu_image image;
};

static void *update(void *argument) {
    struct work *work = argument;
    track_cpu_box box;
    for (int i = 0; i < 4; i++) {
        CHECK(track_cpu_update(work->tracker, &work->image, &box) == TRACK_CPU_OK);
        CHECK(track_cpu_update(NULL, &work->image, &box) == TRACK_CPU_ARGUMENT);
        CHECK(strcmp(track_cpu_last_error(), "tracker is null") == 0);
    }
    return NULL;
}

static void threads_wait_for_each_other_and_a_forked_child_is_refused(void) {
    struct work work;
    pthread_t threads[3];
    struct picture made = picture(0, 1, WIDTH);
    work.image = (track_cpu_image){made.pixels, WIDTH, HEIGHT, 0, TRACK_CPU_GRAY};
    CHECK(track_cpu_create("drmim-p75", 2, &work.tracker) == TRACK_CPU_OK);
    CHECK(track_cpu_init(work.tracker, &work.image, &target) == TRACK_CPU_OK);
    for (int i = 0; i < 3; i++) CHECK(pthread_create(&threads[i], NULL, update, &work) == 0);
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);

    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
        track_cpu_box box;
        int32_t code = track_cpu_update(work.tracker, &work.image, &box);
        track_cpu_destroy(work.tracker);
        _exit(code);
    }
    int status;
    CHECK(waitpid(child, &status, 0) == child);
    CHECK(WIFEXITED(status) && WEXITSTATUS(status) == TRACK_CPU_FORKED);
    track_cpu_destroy(work.tracker);
    release(&made);
}

int main(void) {
    CHECK(atoi(track_cpu_version()) == TRACK_CPU_VERSION_MAJOR);
    formats_and_strides_are_read_within_their_bytes();
    bad_arguments_give_codes_and_write_nothing();
    trackers_outlive_the_model_they_share();
    flight_mode_fills_its_structs();
    threads_wait_for_each_other_and_a_forked_child_is_refused();
    puts("passed");
    return 0;
}
