/* Follows an object through headerless RGB frames and prints x,y,w,h,score for each.
 *
 *     tools/capi/install.sh ~/track-cpu
 *     export PKG_CONFIG_PATH=~/track-cpu/lib/pkgconfig LD_LIBRARY_PATH=~/track-cpu/lib
 *     c++ tools/capi/examples/follow.cpp $(pkg-config --cflags --libs track_cpu) -o follow
 *     ffmpeg -i flight.mp4 -f rawvideo -pix_fmt rgb24 - | ./follow 1280 720 300 120 40 24 */

#include <track_cpu.hpp>

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

int main(int count, char **arguments) try {
    if (count != 7) {
        std::fprintf(stderr, "usage: %s WIDTH HEIGHT X Y W H < frames.rgb\n", arguments[0]);
        return 2;
    }
    const uint32_t width = static_cast<uint32_t>(std::stoul(arguments[1]));
    const uint32_t height = static_cast<uint32_t>(std::stoul(arguments[2]));
    track_cpu_box box = {std::stof(arguments[3]), std::stof(arguments[4]), std::stof(arguments[5]),
                         std::stof(arguments[6])};
    std::vector<uint8_t> pixels(size_t(width) * height * 3);
    const track_cpu_image image = track_cpu::image(pixels.data(), width, height, TRACK_CPU_RGB);

    track_cpu::Tracker tracker;
    bool is_first = true;
    while (std::fread(pixels.data(), 1, pixels.size(), stdin) == pixels.size()) {
        if (is_first) {
            tracker.init(image, box);
        } else {
            box = tracker.update(image);
        }
        is_first = false;
        std::printf("%.3f,%.3f,%.3f,%.3f,%.4f\n", box.x, box.y, box.w, box.h, tracker.score());
    }
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
