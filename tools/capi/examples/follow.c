/* Follows an object through headerless RGB frames and prints x,y,w,h,score for each.
 *
 *     tools/capi/install.sh ~/track-cpu
 *     export PKG_CONFIG_PATH=~/track-cpu/lib/pkgconfig LD_LIBRARY_PATH=~/track-cpu/lib
 *     cc tools/capi/examples/follow.c $(pkg-config --cflags --libs track_cpu) -o follow
 *     ffmpeg -i flight.mp4 -f rawvideo -pix_fmt rgb24 - | ./follow 1280 720 300 120 40 24 */

#include <track_cpu.h>

#include <stdio.h>
#include <stdlib.h>

static int fail(const char *doing) {
    fprintf(stderr, "%s: %s\n", doing, track_cpu_last_error());
    return 1;
}

int main(int count, char **arguments) {
    if (count != 7) {
        fprintf(stderr, "usage: %s WIDTH HEIGHT X Y W H < frames.rgb\n", arguments[0]);
        return 2;
    }
    track_cpu_image image = {NULL, (uint32_t)atoi(arguments[1]), (uint32_t)atoi(arguments[2]), 0,
                             TRACK_CPU_RGB};
    track_cpu_box box = {strtof(arguments[3], NULL), strtof(arguments[4], NULL),
                         strtof(arguments[5], NULL), strtof(arguments[6], NULL)};
    size_t bytes = (size_t)image.width * image.height * 3;
    uint8_t *pixels = malloc(bytes);
    if (bytes > 0 && !pixels) {
        fprintf(stderr, "no memory for %zu bytes\n", bytes);
        return 1;
    }
    image.data = pixels;

    track_cpu_tracker *tracker;
    if (track_cpu_create(NULL, 1, &tracker) != TRACK_CPU_OK) return fail("create");
    int status = 0;
    for (int frame = 0; status == 0 && fread(pixels, 1, bytes, stdin) == bytes; frame++) {
        float score;
        if (frame == 0) {
            if (track_cpu_init(tracker, &image, &box) != TRACK_CPU_OK) status = fail("init");
        } else if (track_cpu_update(tracker, &image, &box) != TRACK_CPU_OK) {
            status = fail("update");
        }
        if (status == 0 && track_cpu_score(tracker, &score) != TRACK_CPU_OK) status = fail("score");
        if (status == 0) printf("%.3f,%.3f,%.3f,%.3f,%.4f\n", box.x, box.y, box.w, box.h, score);
    }
    track_cpu_destroy(tracker);
    free(pixels);
    return status;
}
