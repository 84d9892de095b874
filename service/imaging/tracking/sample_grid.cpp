#include "service/imaging/tracking/sample_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>
#include <string>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

[[noreturn]] void refuse(const std::string& what) {
  throw std::invalid_argument(what);
}

void check_samples(const RfFrame& frame, const char* name) {
  if (frame.samples.size() != frame.sample_count * frame.line_count)
    refuse(fmt::format("{}.samples: {} values for {} samples x {} lines; send the whole frame", name,
                       frame.samples.size(), frame.sample_count, frame.line_count));
  for (std::size_t l = 0; l < frame.line_count; ++l) {
    check_cancelled();
    const std::span line(frame.samples.data() + l * frame.sample_count, frame.sample_count);
    const auto unfit = std::ranges::find_if_not(line, [](float sample) { return std::isfinite(sample); });
    if (unfit != line.end())
      refuse(
          fmt::format("{}.samples: not a finite number at sample {} of line {}; replace it (by 0 if nothing "
                      "was recorded there)",
                      name, unfit - line.begin(), l));
  }
}

void check_size(const RfFrame& pre, const RfFrame& post) {
  if (pre.sample_count != post.sample_count || pre.line_count != post.line_count)
    refuse(
        fmt::format("post: {} x {} samples x lines, but pre has {} x {}; record both with the same settings",
                    post.sample_count, post.line_count, pre.sample_count, pre.line_count));
  if (pre.sample_count < 64 || pre.sample_count > 16384)
    refuse(fmt::format("sample_count: {}, must be 64 to 16384", pre.sample_count));
  if (pre.line_count < 8 || pre.line_count > 2048)
    refuse(fmt::format("line_count: {}, must be 8 to 2048", pre.line_count));
}

// The negated comparisons refuse NaN too.
void check_geometry(const AcquisitionGeometry& g) {
  if (!(g.center_frequency_hz > 0 && g.center_frequency_hz < 1e9))
    refuse("center_frequency_hz: must be above 0 Hz, the transmitted centre frequency");
  if (!(g.sampling_frequency_hz > 0 && g.sampling_frequency_hz <= 5e8))
    refuse("sampling_frequency_hz: must be above 0 and at most 5e8 Hz, the rate of the RF samples");
  if (!(g.sampling_frequency_hz > 2 * g.center_frequency_hz))
    refuse("sampling_frequency_hz: must exceed twice center_frequency_hz; give RF, not demodulated data");
  if (!(g.sound_speed_m_s >= 1000 && g.sound_speed_m_s <= 2500))
    refuse("sound_speed_m_s: must be 1000 to 2500 m/s (soft tissue: 1540)");
  if (!(g.line_pitch_m >= 1e-5 && g.line_pitch_m <= 0.01))
    refuse("line_pitch_m: must be 1e-5 to 0.01 m, the distance between A-lines");
  if (!(g.first_sample_depth_m >= 0 && g.first_sample_depth_m < 1))
    refuse("first_sample_depth_m: must be 0 m or more and below 1 m");
}

// Offset-binary samples stand about a constant that the converter adds: their median, where it is more than
// half of what they deviate from it; echoes alone have a median of nearly 0, and silence stays silent.
float converter_offset(const RfFrame& frame) {
  constexpr std::size_t kLookedAt = 8192;
  const std::size_t every = frame.samples.size() / kLookedAt + 1;
  std::vector<float> values;
  for (std::size_t n = 0; n < frame.samples.size(); n += every) values.push_back(frame.samples[n]);
  const auto offset = static_cast<float>(median(values));
  for (float& v : values) v = std::abs(v - offset);
  return std::abs(offset) > 0.5f * static_cast<float>(median(values)) ? offset : 0;
}

}  // namespace

int whole_steps(double length_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround(length_m / step_m)));
}

int half_width(double window_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround(window_m / 2 / step_m)));
}

SampleGrid centred_grid(const RfFrame& frame, int line_step, int sample_step) {
  const int lines = static_cast<int>(frame.line_count), samples = static_cast<int>(frame.sample_count);
  SampleGrid grid;
  grid.line_step = std::clamp(line_step, 1, lines);
  grid.sample_step = std::clamp(sample_step, 1, samples);
  grid.nx = (lines - 1) / grid.line_step + 1;
  grid.ny = (samples - 1) / grid.sample_step + 1;
  grid.first_line = (lines - 1) % grid.line_step / 2;
  grid.first_sample = (samples - 1) % grid.sample_step / 2;
  return grid;
}

ImageGrid image_grid(const SampleGrid& grid, const AcquisitionGeometry& geometry) {
  return {static_cast<std::size_t>(grid.nx),
          static_cast<std::size_t>(grid.ny),
          (grid.first_line + 0.5) * geometry.line_pitch_m,
          geometry.first_sample_depth_m + grid.first_sample * geometry.sample_pitch_m(),
          grid.line_step * geometry.line_pitch_m,
          grid.sample_step * geometry.sample_pitch_m()};
}

Padding padding(const RfFrame& frame, int samples, int lines) {
  const int line_count = static_cast<int>(frame.line_count),
            sample_count = static_cast<int>(frame.sample_count);
  Padding p;
  p.layout.stride = (sample_count + 2 * samples + 7) / 8 * 8;
  p.layout.origin = lines * p.layout.stride + samples;
  p.total = static_cast<std::size_t>(p.layout.stride) * static_cast<std::size_t>(line_count + 2 * lines);
  return p;
}

void write_into(std::vector<float>& image, const RfFrame& frame, const Padding& p,
                const std::vector<EchoSpan>& spans) {
  const auto samples = static_cast<std::ptrdiff_t>(frame.sample_count);
  const float offset = converter_offset(frame);
  for (std::size_t l = 0; l < frame.line_count; ++l) {
    check_cancelled();
    const auto line = frame.samples.begin() + static_cast<std::ptrdiff_t>(l) * samples;
    const auto to = image.begin() + p.layout.origin + static_cast<std::ptrdiff_t>(l) * p.layout.stride;
    std::fill(to, to + spans[l].first, 0.0f);
    std::transform(line + spans[l].first, line + spans[l].end, to + spans[l].first,
                   [offset](float sample) { return sample - offset; });
    std::fill(to + spans[l].end, to + samples, 0.0f);
  }
}

std::vector<float> padded(const RfFrame& frame, const Padding& p) {
  std::vector<float> image;
  grow(image, p.total);
  write_into(image, frame, p, {frame.line_count, {0, static_cast<int>(frame.sample_count)}});
  return image;
}

void validate(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry& geometry) {
  check_size(pre, post);
  check_geometry(geometry);
  check_samples(pre, "pre");
  check_samples(post, "post");
}

}  // namespace teletact::service
