/* Uses every class of track_cpu.hpp; prints "passed". Made to run under the address sanitizer. */

#include <track_cpu.hpp>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <utility>

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            std::fprintf(stderr, "line %d: %s\n", __LINE__, #condition);                           \
            std::exit(1);                                                                          \
        }                                                                                          \
    } while (0)

namespace {

/* What the header uses of a cv::Mat. */
struct Mat {
    struct Step {
        size_t bytes;
        operator size_t() const { return bytes; }
    };
    int dims, rows, cols;
    uint8_t *data;
    Step step;
    int type; // bits 0 to 2 the depth, then the number of channels less one, as OpenCV's

    int depth() const { return type & 7; }
    int channels() const { return (type >> 3) + 1; }
};

/* The pixels of a gray picture of 96 x 64 with a bright square. */
std::vector<uint8_t> pixels() {
    std::vector<uint8_t> pixels(96 * 64);
    for (int i = 0; i < 96 * 64; i++) {
        const int x = i % 96, y = i / 96;
        const bool inside = x >= 24 && x < 40 && y >= 24 && y < 40;
        pixels[i] = static_cast<uint8_t>(inside ? 230 : (x * 7 + y * 13) % 60);
    }
    return pixels;
}

/* The code of the error that a call throws. */
template <class Call> int32_t code(Call call, const char *words) {
    try {
        call();
    } catch (const track_cpu::Error &error) {
        CHECK(std::strstr(error.what(), words));
        return error.code();
    }
    return TRACK_CPU_OK;
}

const track_cpu_box target = {24, 24, 16, 16};

void matrices_are_taken_without_a_copy(const track_cpu::Model &model) {
    std::vector<uint8_t> gray = pixels();
    Mat mat = {2, 64, 96, gray.data(), {96}, 0};
    const track_cpu_image image = track_cpu::image(mat);
    CHECK(image.data == gray.data() && image.stride == 96 && image.format == TRACK_CPU_GRAY);
    track_cpu::Tracker tracker(model);
    tracker.init(image, target);
    CHECK(tracker.score() == 1);
    const track_cpu_box box = tracker.update(image);
    CHECK(box.w > 0 && tracker.score() >= 0 && tracker.score() <= 1);

    mat.type = 2 << 3;
    mat.step.bytes = 96 * 3;
    CHECK(track_cpu::image(mat).format == TRACK_CPU_BGR);
    mat.type = 5; // 32-bit floats
    CHECK(code([&] { track_cpu::image(mat); }, "CV_8U") == TRACK_CPU_IMAGE);
    mat.type = 1 << 3; // two channels
    CHECK(code([&] { track_cpu::image(mat); }, "CV_8U") == TRACK_CPU_IMAGE);
    const Mat empty = {2, 0, 0, nullptr, {0}, 0};
    CHECK(code([&] { tracker.update(track_cpu::image(empty)); }, "null") == TRACK_CPU_ARGUMENT);
}

void failures_throw_and_free_what_was_made() {
    const std::string missing = "/nonexistent";
    CHECK(code([&] { track_cpu::Model model(missing); }, "/nonexistent") == TRACK_CPU_MODEL);
    CHECK(code([] { track_cpu::Tracker(track_cpu::Model(), 0); }, "0 threads") ==
          TRACK_CPU_ARGUMENT);
    track_cpu_flight_options options = track_cpu::flight_defaults();
    options.present = 2;
    CHECK(code([&] { track_cpu::FlightTracker(track_cpu::Model(), 1, options); }, "present") ==
          TRACK_CPU_ARGUMENT);
}

void flight_mode_tells_presence_and_candidates(const track_cpu::Model &model) {
    std::vector<uint8_t> gray = pixels();
    const track_cpu_image image = track_cpu::image(gray.data(), 96, 64, TRACK_CPU_GRAY);
    track_cpu::FlightTracker tracker(model);
    tracker.init(image, target);
    const track_cpu_flight_track track = tracker.update(image, 0.04);
    CHECK(track.presence == tracker.score() && track.searches >= 1);
    CHECK(tracker.candidates().size() <= 5);
}

void trackers_are_moved_and_used_by_threads(const track_cpu::Model &model) {
    std::vector<uint8_t> gray = pixels();
    const track_cpu_image image = track_cpu::image(gray.data(), 96, 64, TRACK_CPU_GRAY);
    track_cpu::Tracker first(model, 2);
    first.init(image, target);
    track_cpu::Tracker tracker = std::move(first);
    std::thread other([&] { tracker.update(image); });
    tracker.update(image);
    other.join();
    CHECK(code([&] { first.update(image); }, "tracker is null") == TRACK_CPU_ARGUMENT);
    first = track_cpu::Tracker(model);
    first.init(image, target);
}

} // namespace

int main() {
    const track_cpu::Model model("drmim-p75");
    matrices_are_taken_without_a_copy(model);
    failures_throw_and_free_what_was_made();
    flight_mode_tells_presence_and_candidates(model);
    trackers_are_moved_and_used_by_threads(model);
    std::puts("passed");
}
