/* track-cpu for C++11 and later: objects that end themselves, exceptions in place of codes.
 *
 *     track_cpu::Tracker tracker;                               // the standard model, one thread
 *     tracker.init(track_cpu::image(mat), {300, 120, 40, 24});  // mat: a cv::Mat of bytes, BGR
 *     track_cpu_box box = tracker.update(track_cpu::image(next));
 *
 *     track_cpu::Model model("drmim-p75");                      // one model, several trackers
 *     track_cpu::FlightTracker first(model), second(model);
 *     track_cpu_flight_track track = first.update(track_cpu::image(next), 0.04);
 *     if (track.believed) point(track.box);
 *
 * Shapes, units and the errors of each call are those of track_cpu.h. Every failure is a
 * track_cpu::Error. Objects can be moved, not copied; a moved-from object can only be destroyed or
 * assigned to. */

#ifndef TRACK_CPU_HPP
#define TRACK_CPU_HPP

#include "track_cpu.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace track_cpu {

/* What the library says went wrong. */
class Error : public std::runtime_error {
public:
    Error(int32_t code, const std::string &words) : std::runtime_error(words), code_(code) {}

    /* TRACK_CPU_ARGUMENT ... TRACK_CPU_FORKED. */
    int32_t code() const noexcept { return code_; }

private:
    int32_t code_;
};

namespace detail {

inline void check(int32_t code) {
    if (code != TRACK_CPU_OK) throw Error(code, track_cpu_last_error());
}

struct Destroy {
    void operator()(track_cpu_model *model) const noexcept { track_cpu_model_destroy(model); }
    void operator()(track_cpu_tracker *tracker) const noexcept { track_cpu_destroy(tracker); }
};

} // namespace detail

/* A picture that the caller keeps; a stride of 0 means that there is no gap between rows. */
inline track_cpu_image image(const uint8_t *data, uint32_t width, uint32_t height,
                             uint32_t format = TRACK_CPU_BGR, size_t stride = 0) {
    return track_cpu_image{data, width, height, stride, format};
}

/* The picture of a cv::Mat of bytes with 1 (gray), 3 (BGR) or 4 channels (BGRA), without a copy:
 * the matrix must live until the call that takes the picture ends. */
template <class Mat> track_cpu_image image(const Mat &mat) {
    const int channels = mat.channels();
    if (mat.dims != 2 || mat.depth() != 0 || (channels != 1 && channels != 3 && channels != 4)) {
        throw Error(TRACK_CPU_IMAGE, "the matrix is no picture: expected rows and columns of 1, 3 "
                                     "or 4 unsigned bytes (CV_8U)");
    }
    const uint32_t format = channels == 1   ? TRACK_CPU_GRAY
                            : channels == 3 ? TRACK_CPU_BGR
                                            : TRACK_CPU_BGRA;
    return image(mat.data, static_cast<uint32_t>(mat.cols), static_cast<uint32_t>(mat.rows), format,
                 static_cast<size_t>(mat.step));
}

/* The default options of flight mode. */
inline track_cpu_flight_options flight_defaults() {
    track_cpu_flight_options options;
    detail::check(track_cpu_flight_defaults(&options));
    return options;
}

/* Weights that any number of trackers share; it may end before them. */
class Model {
public:
    /* Loads a built-in model by name, or a weights file (UTF-8 path). */
    explicit Model(const std::string &name, uint32_t precision = TRACK_CPU_FASTEST)
        : Model(name.c_str(), precision) {}

    /* Loads the standard model if `name` is null. */
    explicit Model(const char *name = nullptr, uint32_t precision = TRACK_CPU_FASTEST) {
        track_cpu_model *made;
        detail::check(track_cpu_model_load(name, precision, &made));
        handle_.reset(made);
    }

    const track_cpu_model *get() const noexcept { return handle_.get(); }

private:
    std::unique_ptr<track_cpu_model, detail::Destroy> handle_;
};

/* Follows one object. Calls from several threads wait for each other. */
class Tracker {
public:
    explicit Tracker(const Model &model = Model(), uint32_t threads = 1) {
        track_cpu_tracker *made;
        detail::check(track_cpu_create_from(model.get(), threads, &made));
        handle_.reset(made);
    }

    /* Takes the content of the box as the new target. On failure the old target stays. */
    void init(const track_cpu_image &image, const track_cpu_box &target) {
        detail::check(track_cpu_init(get(), &image, &target));
    }

    /* Finds the target in the next picture. */
    track_cpu_box update(const track_cpu_image &image) {
        track_cpu_box box;
        detail::check(track_cpu_update(get(), &image, &box));
        return box;
    }

    /* Says how sure the tracker is of the last box, from 0 to 1. */
    float score() const {
        float score;
        detail::check(track_cpu_score(get(), &score));
        return score;
    }

    track_cpu_tracker *get() const noexcept { return handle_.get(); }

protected:
    explicit Tracker(track_cpu_tracker *made) noexcept : handle_(made) {}

private:
    std::unique_ptr<track_cpu_tracker, detail::Destroy> handle_;
};

/* Follows one object and says whether it is there. */
class FlightTracker : public Tracker {
public:
    explicit FlightTracker(const Model &model = Model(), uint32_t threads = 1,
                           const track_cpu_flight_options &options = flight_defaults())
        : Tracker(make(model, threads, options)) {}

    /* Finds the target in the next picture, taken `elapsed` seconds after the one before
     * (0: 1 / fps); searches for a lost one take at most `deadline` seconds (0: two searches). */
    track_cpu_flight_track update(const track_cpu_image &image, double elapsed = 0,
                                  double deadline = 0) {
        track_cpu_flight_track track;
        detail::check(track_cpu_update_flight(get(), &image, elapsed, deadline, &track));
        return track;
    }

    /* Returns the places that the last search found, the chosen one first. */
    std::vector<track_cpu_candidate> candidates() const {
        std::vector<track_cpu_candidate> places(5);
        uint32_t count = 0;
        const uint32_t capacity = static_cast<uint32_t>(places.size());
        detail::check(track_cpu_candidates(get(), places.data(), capacity, &count));
        places.resize(count);
        return places;
    }

private:
    static track_cpu_tracker *make(const Model &model, uint32_t threads,
                                   const track_cpu_flight_options &options) {
        track_cpu_tracker *made;
        detail::check(track_cpu_create_flight_from(model.get(), threads, &options, &made));
        return made;
    }
};

} // namespace track_cpu

#endif
