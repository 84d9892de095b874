#include "client/report/pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "client/files/picture.h"

namespace teletact::client {
namespace {

const std::string kLook = "set grid lc rgb '#dddddd'\nset key top right\n";

// Counts per bin of a logarithmic histogram, as gnuplot data "centre count"; values in ms.
std::string histogram(const std::string& name, const std::vector<double>& values_s) {
  constexpr double kLowestMs = 0.01, kBinsPerDecade = 20;
  constexpr int kBins = 100;  // up to 1 s
  std::vector<std::size_t> counts(kBins, 0);
  for (const double value_s : values_s) {
    const double bin = kBinsPerDecade * std::log10(std::max(value_s * 1e3, kLowestMs) / kLowestMs);
    ++counts[static_cast<std::size_t>(std::clamp(bin, 0.0, kBins - 1.0))];
  }
  std::string out = "$" + name + " << EOD\n";
  for (int k = 0; k < kBins; ++k)
    out += fmt::format("{:.6g} {}\n", kLowestMs * std::pow(10, (k + 0.5) / kBinsPerDecade), counts[k]);
  return out + "EOD\n";
}

std::vector<double> differences(const std::vector<double>& times_s) {
  std::vector<double> out;
  for (std::size_t k = 1; k < times_s.size(); ++k) out.push_back(times_s[k] - times_s[k - 1]);
  return out;
}

}  // namespace

void draw_modulus(const std::filesystem::path& file, const Tissue& tissue, const ModulusGrid& estimated) {
  Panel truth;
  truth.title = "true Young's modulus";
  truth.nx = estimated.nx;
  truth.ny = estimated.ny;
  truth.origin_x_m = estimated.x0_m;
  truth.origin_y_m = estimated.y0_m;
  truth.dx_m = estimated.dx_m;
  truth.dy_m = estimated.dy_m;
  truth.unit = "kPa";
  truth.factor = 1e-3;
  truth.low = 0;
  double highest = 0;
  for (std::size_t j = 0; j < truth.ny; ++j)
    for (std::size_t i = 0; i < truth.nx; ++i) {
      truth.values.push_back(static_cast<float>(tissue.true_modulus(estimated.x(i), estimated.y(j))));
      highest = std::max<double>(highest, truth.values.back());
    }
  truth.high = highest;
  Panel estimate = truth;
  estimate.title = "estimated Young's modulus";
  estimate.values = estimated.pa;
  PictureOptions options;
  options.columns = 1;
  options.panel_width = 900;
  write_png(file, std::vector<Panel>{truth, estimate}, options);
}

bool draw_force(const std::filesystem::path& file, const std::vector<ForceSamplePoint>& force) {
  if (force.empty()) return false;
  bool stated = false, known = false;
  // A blank line ends a band: nothing is drawn where nothing is stated.
  std::string felt = "$felt << EOD\n", band = "$band << EOD\n", truth = "$truth << EOD\n";
  const double begin_s = force.front().time_s;
  for (const ForceSamplePoint& p : force) {
    const std::string at = fmt::format("{:.4f} {:.3f}", p.time_s - begin_s, p.x_m * 1e3);
    felt += fmt::format("{} {:.5f}\n", at, p.felt_n);
    if (p.stated)
      band += fmt::format("{} {:.5f} {:.5f}\n", at, p.felt_n * (1 - p.stated->half_width),
                          p.felt_n * (1 + p.stated->half_width + p.stated->above));
    else if (!band.ends_with("\n\n"))
      band += "\n";
    if (p.true_n) truth += fmt::format("{} {:.5f}\n", at, *p.true_n);
    stated = stated || p.stated, known = known || p.true_n;
  }
  struct Look {
    const char *column, *band, *truth, *felt;
  };
  const auto panel = [&](const char* axis, const Look& look) {
    std::string all = fmt::format("set xlabel '{}'\nplot ", axis);
    if (stated)
      all +=
          fmt::format("$band using {} lc rgb '#f0b8a8' title 'stated for what is felt, 95 %', ", look.band);
    if (known)
      all += fmt::format("$truth using {}:3 with {} lc rgb '#999999' title 'true tissue', ", look.column,
                         look.truth);
    return all +
           fmt::format("$felt using {}:3 with {} lc rgb '#c03020' title 'felt'\n", look.column, look.felt);
  };
  constexpr const char* kPoints = "points pt 7 ps 0.3";
  // The way goes to and fro: there each sample has a bar of its own.
  const Look over_way{"2", "2:3:(0):($4-$3) with vectors nohead", kPoints, kPoints},
      over_time{"1", "1:3:4 with filledcurves", "lines lw 3", "lines"};
  plot(file, 1100, 800,
       kLook + felt + "EOD\n" + (stated ? band + "EOD\n" : "") + (known ? truth + "EOD\n" : "") +
           "set multiplot layout 2,1\nset ylabel 'force (N)'\nset yrange [0:*]\n" +
           panel("position along the surface (mm)", over_way) + panel("time (s)", over_time) +
           "unset multiplot\n");
  return true;
}

void draw_latency(const std::filesystem::path& file, const TouchRecord& touch) {
  std::vector<double> latency_s;
  for (const TouchAnswerTime& answer : touch.answers) latency_s.push_back(answer.latency_s);
  plot(file, 800, 500,
       kLook + histogram("latency", latency_s) +
           "set logscale x\nset xlabel 'pose sampled to answer received (ms)'\nset ylabel 'answers'\nset "
           "xrange "
           "[0.1:1000]\nset style fill solid 0.6\nplot $latency using 1:2 with boxes lc rgb '#3060a0' "
           "notitle\n");
}

void draw_periods(const std::filesystem::path& file, const TouchRecord& touch) {
  std::vector<double> ticks_s, answers_s;
  for (const TouchTick& tick : touch.ticks) ticks_s.push_back(tick.time_s);
  for (const TouchAnswerTime& answer : touch.answers) answers_s.push_back(answer.arrived_s);
  plot(file, 800, 700,
       kLook + histogram("servo", differences(ticks_s)) + histogram("answers", differences(answers_s)) +
           "set multiplot layout 2,1\nset logscale xy\nset xrange [0.05:1000]\nset yrange [0.5:*]\n"
           "set style fill solid 0.6\nset xlabel 'servo period (ms)'\nset ylabel 'ticks'\n"
           "plot $servo using 1:2 with boxes lc rgb '#3060a0' notitle\n"
           "set xlabel 'between answers (ms)'\nset ylabel 'answers'\n"
           "plot $answers using 1:2 with boxes lc rgb '#3060a0' notitle\nunset multiplot\n");
}

bool draw_tactile(const std::filesystem::path& file, const TouchRecord& touch) {
  constexpr std::size_t kMaxFrames = 8;
  constexpr double kMinShare = 0.2;  // of the largest force: less is hardly a contact
  double largest_n = 0;
  for (const TactileFrame& frame : touch.tactile) largest_n = std::max(largest_n, frame.image.force_n);
  std::vector<const TactileFrame*> contacts;
  for (const TactileFrame& frame : touch.tactile)
    if (frame.image.force_n > 0 && frame.image.force_n >= kMinShare * largest_n) contacts.push_back(&frame);
  if (contacts.empty()) return false;
  const std::size_t frames = std::min(kMaxFrames, contacts.size());
  std::vector<const TactileFrame*> shown;
  for (std::size_t k = 0; k < frames; ++k)
    shown.push_back(contacts[(2 * k + 1) * contacts.size() / (2 * frames)]);
  std::vector<Panel> panels;
  const auto add_row = [&](const std::vector<float> TactileImage::*values, const char* name,
                           bool both_signs) {
    double high = 0;
    for (const TactileFrame* frame : shown)
      for (const float value : frame->image.*values) high = std::max<double>(high, std::abs(value));
    for (const TactileFrame* frame : shown) {
      const TactileImage& image = frame->image;
      Panel& panel = panels.emplace_back();
      panel.title = fmt::format("{} {:.1f} s", name, frame->arrived_s - touch.tactile.front().arrived_s);
      panel.nx = image.along_x, panel.ny = image.along_z;
      panel.origin_x_m = image.begin_x_m, panel.origin_y_m = image.begin_z_m;
      panel.dx_m = panel.dy_m = image.pitch_m;
      panel.down = "z";
      panel.values = image.*values;
      panel.unit = "kPa", panel.factor = 1e-3;
      panel.low = both_signs ? -high : 0, panel.high = high;
    }
  };
  add_row(&TactileImage::pressure_pa, "pressure", false);
  const bool beyond = std::all_of(shown.begin(), shown.end(),
                                  [](const TactileFrame* f) { return !f->image.beyond_pa.empty(); });
  if (beyond) add_row(&TactileImage::beyond_pa, "beyond", true);
  PictureOptions options;
  options.columns = frames;
  options.panel_width = 160;
  write_png(file, panels, options);
  return true;
}

}  // namespace teletact::client
