#include "client/session/tactile_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace teletact::client {
namespace {

constexpr std::array<const char*, 5> kMore{"  ", "░░", "▒▒", "▓▓", "██"};
constexpr std::array<const char*, 3> kLess{"  ", "··", "--"};

float largest(std::span<const float> values) {
  float most = 0;
  for (const float value : values) most = std::max(most, std::abs(value));
  return most;
}

const char* cell(float value, float full) {
  if (!(full > 0)) return kMore[0];
  const auto level = [&](std::size_t levels) {
    const float steps = std::abs(value) / full * static_cast<float>(levels - 1);
    return std::min(levels - 1, static_cast<std::size_t>(std::lround(steps)));
  };
  return value < 0 ? kLess[level(kLess.size())] : kMore[level(kMore.size())];
}

std::string row(std::span<const float> values, float full) {
  std::string out = "│";
  for (const float value : values) out += cell(value, full);
  return out + "│";
}

}  // namespace

std::string tactile_view(const TactileImage& image) {
  const float full = largest(image.pressure_pa), most = largest(image.beyond_pa);
  const bool beyond = !image.beyond_pa.empty();
  std::string out =
      fmt::format("{:.3f} N at x {:.1f} mm, z {:.1f} mm; full scale {:.2f} kPa", image.force_n,
                  1e3 * (image.begin_x_m + image.pitch_m * double(image.along_x - 1) / 2),
                  1e3 * (image.begin_z_m + image.pitch_m * double(image.along_z - 1) / 2), 1e-3 * full);
  if (beyond) out += fmt::format(", and {:.2f} kPa beyond homogeneous tissue on the right", 1e-3 * most);
  out += '\n';
  for (std::size_t k = 0; k < image.along_z; ++k) {
    const auto line = [&](std::span<const float> values) {
      return values.subspan(k * image.along_x, image.along_x);
    };
    out += row(line(image.pressure_pa), full);
    if (beyond) out += "  " + row(line(image.beyond_pa), most);
    out += '\n';
  }
  return out;
}

std::string TactileScreen::frame(const TactileImage& image) {
  constexpr const char* kClearRest = "\033[K\n";
  const std::string view = tactile_view(image);
  if (!in_place_) return view;
  std::string out = lines_ > 0 ? fmt::format("\033[{}A", lines_) : "";
  lines_ = 0;
  for (const char c : view) {
    if (c != '\n') {
      out += c;
      continue;
    }
    out += kClearRest;
    ++lines_;
  }
  return out;
}

}  // namespace teletact::client
