// What a service says on a touch stream: how it opened, its answers and tactile images.
#include "client/link/touch_answers.h"

#include <cmath>

#include "client/link/tactile_image.h"
#include "tests/fuzzers/client/fuzzers.h"
#include "tests/fuzzers/support/delimited.h"

namespace teletact::fuzzers {
namespace {

using client::ServoAnswer;
using client::TouchAnswers;

void check(const ServoAnswer& answer) {
  require(answer.period_s > 0 && answer.period_s <= 10, "a period that cannot be");
  require(answer.sample.relative_error >= 0 && answer.sample.relative_error <= 1,
          "an error beyond the whole force");
  require(
      answer.region.begin_x_m <= answer.region.end_x_m && answer.region.begin_z_m <= answer.region.end_z_m,
      "a region that ends before it begins");
  require(std::abs(answer.sample.surface.normal.norm() - 1) < 1e-9, "a normal that is no unit vector");
  require(std::isfinite(answer.round_trip_s) && answer.round_trip_s >= 0 &&
              std::isfinite(answer.clock_offset_s) && std::isfinite(answer.modulus_time_s) &&
              std::isfinite(answer.sample.pose_time_s),
          "a time that is not finite");
  require(!answer.sample.contact || (answer.has_force && answer.covered), "contact where there is no force");
}

void check(const client::TactileImage& image) {
  const std::size_t taxels = image.along_x * image.along_z;
  require(taxels > 0 && image.pressure_pa.size() == taxels, "taxels that do not fill an image");
  require(image.beyond_pa.empty() || image.beyond_pa.size() == taxels,
          "taxels that do not fill the other image");
  require(image.pitch_m > 0 && std::isfinite(image.begin_x_m) && std::isfinite(image.begin_z_m),
          "an image that is nowhere");
  for (const float pressure_pa : image.pressure_pa)
    require(std::isfinite(pressure_pa), "a pressure that is not finite");
}

void check(const client::TouchLinkStats& stats) {
  require(stats.dropped + stats.distinct <= stats.answers, "more answers than came");
  for (const double number : {stats.largest_strain, stats.clock_offset_s, stats.clock_offset_error_s,
                              stats.layer_depth_m, stats.period_s})
    require(std::isfinite(number), "a figure that is not finite");
}

}  // namespace

bool touch_answers(Bytes bytes) {
  require_plain_log();
  TouchAnswers answers;
  std::int64_t now_ns = 5'000'000'000;
  Delimited responses(bytes);
  while (const auto response = responses.next<v1::TouchResponse>()) {
    now_ns += 1'000'000;
    if (response->has_opened()) {
      const std::string problem = answers.take_opened(response->opened(), now_ns);
      if (problem.empty()) continue;
      require_one_line(problem);
      return false;  // the link gives it up
    }
    if (!response->has_answer() || answers.stats.streams == 0) continue;
    const v1::TouchAnswer& answer = response->answer();
    if (const auto converted = answers.take_answer(answer, true, now_ns - 500'000, now_ns)) check(*converted);
    if (const auto image = client::tactile_from(answer.tactile())) check(*image);
    check(answers.stats);
  }
  return answers.stats.answers > 0;
}

}  // namespace teletact::fuzzers
