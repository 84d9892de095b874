#include "service/imaging/tracking/echoes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/input_checks.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kRowM = 0.4e-3, kAveragedM = 2e-3;  // along the lines, across them
constexpr float kSilent = 0.1f;                      // of the power beside it
constexpr std::size_t kAbout = 4;  // rows beside it that are averaged, and one that it may begin in

// x(k) - (x(k - half) + x(k + half)) / 2, `half` a period: no constant passes, and little hum.
std::vector<float> power_of(const RfFrame& frame, std::size_t half, std::size_t step) {
  const std::size_t rows = frame.sample_count / step;
  std::vector<float> power(rows * frame.line_count);
  for (std::size_t l = 0; l < frame.line_count; ++l) {
    check_cancelled();
    const float* const line = frame.samples.data() + l * frame.sample_count;
    for (std::size_t r = 0; r < rows; ++r) {
      const std::size_t begin = std::max(r * step, half),
                        end = std::min((r + 1) * step, frame.sample_count - half);
      float sum = 0;
      for (std::size_t k = begin; k < end; ++k) {
        const float at = line[k] - 0.5f * (line[k - half] + line[k + half]);
        sum += at * at;
      }
      power[r + rows * l] = end > begin ? sum / static_cast<float>(end - begin) : 0;
    }
  }
  return power;
}

float typical(std::vector<float> values) {
  return static_cast<float>(median(values));
}

// The first row of the silence in which a line ends; `power.size()`: it does not.
std::size_t silent_from(const std::vector<float>& power) {
  const std::size_t rows = power.size();
  std::vector<float> most = power;  // of the row and those after it
  for (std::size_t r = rows; r-- > 1;) most[r - 1] = std::max(most[r - 1], most[r]);
  for (std::size_t r = kAbout + 1; r + 1 < rows; ++r) {
    float beside = 0;
    for (std::size_t k = 0; k < kAbout; ++k) beside += power[r - 2 - k] / kAbout;
    // What is louder than all below it may be a pulse or a bone: half of the line must be heard.
    if (beside > 0 && most[r] <= kSilent * beside && (2 * r >= rows || most[r] == 0) &&
        most[r] <= kSilent * typical({power.begin(), power.begin() + static_cast<std::ptrdiff_t>(r)}))
      return r;
  }
  return rows;
}

// Lines that are silent beside others.
std::vector<bool> silent_lines(const std::vector<float>& power, std::size_t lines) {
  const std::size_t rows = power.size() / lines;
  std::vector<float> of_line;
  for (std::size_t l = 0; l < lines; ++l) {
    const auto first = power.begin() + static_cast<std::ptrdiff_t>(l * rows);
    of_line.push_back(typical({first, first + static_cast<std::ptrdiff_t>(rows)}));
  }
  const float usual = kSilent * typical(of_line);
  std::vector<bool> silent(lines, false);
  const auto look = [&](auto at) {
    for (std::size_t n = 1; n < lines; ++n) {
      const float least = std::min(kSilent * of_line[at(n - 1)], usual);
      for (; n < lines && of_line[at(n)] < least; ++n) silent[at(n)] = true;
    }
  };
  look([](std::size_t n) { return n; });
  look([lines](std::size_t n) { return lines - 1 - n; });
  return silent;
}

}  // namespace

Echoes find_echoes(const RfFrame& frame, const AcquisitionGeometry& geometry) {
  const std::size_t lines = frame.line_count, samples = frame.sample_count;
  const double own_hz = mean_frequency(frame, geometry.sampling_frequency_hz),
               hz = own_hz > 0 ? own_hz : geometry.center_frequency_hz;
  const auto half = static_cast<std::size_t>(
      std::clamp(std::lround(geometry.sampling_frequency_hz / hz / 2), 1L, static_cast<long>(samples / 4)));
  Echoes out;
  out.step = std::max(kMinStep, whole_steps(kRowM, geometry.sample_pitch_m()));
  out.rows = static_cast<int>(samples) / out.step;
  out.power = power_of(frame, half, static_cast<std::size_t>(out.step));

  const auto rows = static_cast<std::size_t>(out.rows);
  const std::vector<bool> silent = silent_lines(out.power, lines);
  const auto reach = static_cast<std::size_t>(half_width(kAveragedM, geometry.line_pitch_m));
  // Of lines about one, or of all: what is silent there.
  const auto span = [&](std::size_t line, std::size_t about) {
    std::vector<float> sum(rows, 0.0f);
    for (std::size_t l = line - std::min(line, about); l < std::min(line + about + 1, lines); ++l)
      for (std::size_t r = 0; r < rows && !silent[l]; ++r) sum[r] += out.power[r + rows * l];
    const auto below = static_cast<int>(silent_from(sum));
    std::ranges::reverse(sum);
    const int above = out.rows - static_cast<int>(silent_from(sum));
    // Silence may begin within the row before.
    return EchoSpan{above > 0 ? (above + 1) * out.step : 0,
                    below < out.rows ? (below - 1) * out.step : static_cast<int>(samples)};
  };
  const EchoSpan all = span(lines / 2, lines);
  for (std::size_t l = 0; l < lines; ++l) {
    check_cancelled();
    const EchoSpan own = silent[l] ? EchoSpan{} : span(l, reach);
    const int first = std::max(own.first, all.first);
    out.lines.push_back({first, std::max(first, std::min(own.end, all.end))});
  }
  return out;
}

// Rows of `power` in the upper half of the frame where most lines are ten times as bright as above and below.
std::vector<int> bright_rows(const Echoes& echoes) {
  constexpr int kThick = 3, kMean = 3;  // rows: half of a bright line, and those beside it
  const int lines = static_cast<int>(echoes.lines.size());
  std::vector<int> bright;
  for (int r = kThick; r < std::min(echoes.rows / 2, echoes.rows - kThick - kMean); ++r) {
    int found = 0;
    for (int l = 0; l < lines; ++l) {
      const float* const at = echoes.power.data() + static_cast<std::ptrdiff_t>(l) * echoes.rows + r;
      const auto mean = [](const float* first, const float* end) {
        return std::accumulate(first, end, 0.0f) / static_cast<float>(end - first);
      };
      const float beside = std::max(mean(at - std::min(kThick + kMean - 1, r), at - kThick + 1),
                                    mean(at + kThick, at + kThick + kMean)),
                  peak = *std::max_element(at - 1, at + 2);
      found += peak > 0 && kSilent * peak >= beside;
    }
    if (2 * found > lines) bright.push_back(r);
  }
  return bright;
}

// Correlation of rows of the frames without any motion.
std::vector<float> alike_rows(const RfFrame& pre, const RfFrame& post, int first, int end, int step) {
  std::vector<float> alike;
  for (int r = first; r < end; ++r) {
    check_cancelled();
    double own = 0, other = 0, both = 0;
    for (std::size_t l = 0; l < pre.line_count; ++l)
      for (int k = std::max(r * step, 1); k < (r + 1) * step; ++k) {
        const std::size_t n = static_cast<std::size_t>(k) + pre.sample_count * l;
        const double a = pre.samples[n] - pre.samples[n - 1], b = post.samples[n] - post.samples[n - 1];
        own += a * a, other += b * b, both += a * b;
      }
    alike.push_back(own > 0 && other > 0 ? static_cast<float>(both / std::sqrt(own * other)) : 1);
  }
  return alike;
}

int coupling_end(const RfFrame& pre, const RfFrame& post, const Echoes& echoes) {
  constexpr float kAlike = 0.7f;  // correlation without any motion; below it less than half of that
  constexpr int kThick = 3;
  const std::vector<int> bright = bright_rows(echoes);
  if (bright.empty()) return 0;
  const std::vector<float> alike = alike_rows(pre, post, 0, echoes.rows, echoes.step);
  for (auto row = bright.rbegin(); row != bright.rend(); ++row) {
    const auto above = alike.begin() + std::max(*row - kThick, 1), below = alike.begin() + *row + kThick;
    const auto silent = std::ranges::count_if(echoes.lines, [&](const EchoSpan& span) {
      return span.first > 0 && span.first >= (*row - kThick - 1) * echoes.step;
    });
    if (2 * silent > std::ssize(echoes.lines) ||
        (typical({alike.begin(), above}) > kAlike && typical({below, alike.end()}) < kAlike / 2))
      return *row * echoes.step;
  }
  return 0;
}

int still_from(const RfFrame& pre, const RfFrame& post, int step) {
  constexpr float kStill = 0.95f, kMoving = 0.5f;
  const int rows = static_cast<int>(pre.sample_count) / step;
  int first = rows;
  while (first > 0 && alike_rows(pre, post, first - 1, first, step)[0] > kStill) --first;
  const auto about = static_cast<int>(kAbout);
  if (first <= about || rows - first < about) return static_cast<int>(pre.sample_count);
  // It may begin within the row before.
  return typical(alike_rows(pre, post, first - 1 - about, first - 1, step)) < kMoving
             ? (first - 1) * step
             : static_cast<int>(pre.sample_count);
}

std::vector<EchoSpan> away_from_silence(const std::vector<EchoSpan>& lines, int samples, int half_lines,
                                        int half_samples) {
  const auto count = static_cast<int>(lines.size());
  std::vector<EchoSpan> out;
  for (int l = 0; l < count; ++l) {
    EchoSpan span{0, samples};
    for (int n = std::max(l - half_lines, 0); n <= std::min(l + half_lines, count - 1); ++n) {
      const EchoSpan& heard = lines[static_cast<std::size_t>(n)];
      if (heard.first > 0) span.first = std::max(span.first, heard.first + half_samples);
      if (heard.end < samples) span.end = std::min(span.end, heard.end - half_samples);
    }
    out.push_back(span);
  }
  return out;
}

}  // namespace teletact::service
