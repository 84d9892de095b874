#include "client/recordings/recorded_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace teletact::client {
namespace {

constexpr double kSamePlaneM = 1e-6;
constexpr double kUneven = 0.01;  // of the planes' spacing

// How many pairs there are, by the option that is given most often.
class Count {
 public:
  template <class T>
  void add(const char* option, const std::vector<T>& values) {
    if (values.size() <= 1) return;
    if (pairs_ > 1 && values.size() != pairs_)
      throw FrameInputError(fmt::format("{} is given {} times, {} {}: give each once, or once for each pair",
                                        by_, pairs_, option, values.size()));
    pairs_ = values.size(), by_ = option;
  }
  std::size_t pairs() const { return pairs_; }

 private:
  std::size_t pairs_ = 1;
  const char* by_ = "";
};

template <class T>
const T* of_pair(const std::vector<T>& values, std::size_t p) {
  return values.empty() ? nullptr : &values[values.size() == 1 ? 0 : p];
}

void require_even(const std::vector<RecordedPlace>& places) {
  if (places.size() < 3) return;
  const double pitch = (*places.back().z_m - *places.front().z_m) / static_cast<double>(places.size() - 1);
  for (std::size_t k = 0; k + 1 < places.size(); ++k)
    if (std::abs(*places[k + 1].z_m - *places[k].z_m - pitch) > kUneven * pitch)
      throw FrameInputError(
          fmt::format("--z-m: planes at {:.6g} and {:.6g} m are not {:.6g} m apart as on "
                      "average; a volume needs them evenly apart: leave some out",
                      *places[k].z_m, *places[k + 1].z_m, pitch));
}

}  // namespace

std::vector<RecordedPlace> recorded_places(const RecordedSetOptions& options) {
  Count count;
  count.add("--pre", options.pre);
  count.add("--post", options.post);
  count.add("--post-variable", options.post_variable);
  count.add("--pre-frame", options.pre_frame);
  count.add("--post-frame", options.post_frame);
  count.add("--force-n", options.force_n);
  count.add("--z-m", options.z_m);
  if (options.pre.empty() || options.post.empty()) throw FrameInputError("give --pre and --post");
  if (options.z_m.size() == 1 && count.pairs() > 1)
    throw FrameInputError(
        "--z-m is given once: give it for each pair, or leave it out where all are of one place");
  std::vector<RecordedPlace> places;
  for (std::size_t p = 0; p < count.pairs(); ++p) {
    RecordedFrameOptions pair = options.common;
    pair.pre = *of_pair(options.pre, p);
    pair.post = *of_pair(options.post, p);
    if (const auto* variable = of_pair(options.post_variable, p)) pair.post_variable = *variable;
    if (const auto* frame = of_pair(options.pre_frame, p)) pair.pre_frame = *frame;
    if (const auto* frame = of_pair(options.post_frame, p)) pair.post_frame = *frame;
    if (const auto* force = of_pair(options.force_n, p)) pair.force_n = *force;
    std::optional<double> z_m;
    if (const auto* z = of_pair(options.z_m, p)) z_m = *z;
    const auto same = std::find_if(places.begin(), places.end(), [&](const RecordedPlace& place) {
      return !z_m || std::abs(*place.z_m - *z_m) <= kSamePlaneM;
    });
    if (same == places.end())
      places.push_back({z_m, {pair}});
    else
      same->pairs.push_back(pair);
  }
  std::sort(places.begin(), places.end(), [](const RecordedPlace& a, const RecordedPlace& b) {
    return a.z_m.value_or(0) < b.z_m.value_or(0);
  });
  require_even(places);
  return places;
}

void require_one_geometry(const std::vector<RecordedPlace>& places) {
  std::optional<v1::Acquisition> first;
  for (const RecordedPlace& place : places)
    for (const RecordedFrameOptions& pair : place.pairs) {
      const v1::Acquisition now = read_recorded_frames(pair).acquisition;
      if (!first) first = now;
      if (now.sample_count() != first->sample_count() || now.line_count() != first->line_count())
        throw FrameInputError(
            fmt::format("{} has {} samples x {} lines, the first pair {} x {}: all pairs must be equal",
                        pair.pre.string(), now.sample_count(), now.line_count(), first->sample_count(),
                        first->line_count()));
      if (now.line_pitch_m() != first->line_pitch_m() ||
          now.first_sample_depth_m() != first->first_sample_depth_m() ||
          now.sampling_frequency_hz() != first->sampling_frequency_hz() ||
          now.sound_speed_m_s() != first->sound_speed_m_s())
        throw FrameInputError(
            pair.pre.string() +
            " has another line pitch, first depth, sampling frequency or sound speed than the first pair");
    }
}

}  // namespace teletact::client
