// What the chart holds the product to. A figure that this run has no method or no case for is left out.
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/phantoms/metrics.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The product's estimator.
const json& default_of(const json& methods) {
  return methods.at(0);
}

const json& middle_of(const json& result) {
  for (const json& c : result.at("conditions"))
    if (on_curve(c, "middle")) return c;
  throw BenchError("the chart has no middle");
}

void add_rigid(const json& rigid, std::vector<Target>& targets) {
  const json& phases = default_of(rigid.at("methods")).at("phases");
  double squares = 0, bias = 0;
  for (const json& phase : phases) {
    squares += std::pow(number(phase.at("rmse_m")), 2);
    bias = std::max(bias, std::abs(number(phase.at("bias_m"))));
  }
  const double rmse_m = std::sqrt(squares / static_cast<double>(phases.size()));
  const double bound_m = number(rigid.at("bound_m")) / std::sqrt(number(rigid.at("independent_lines")));
  targets.push_back({"1a. RMSE of a rigid shift over the bound of its window", rmse_m / bound_m, 1.2, ""});
  targets.push_back({"1a. bias of a rigid shift, the largest of all phases", 1e6 * bias, 0.1, "um"});
}

// The phantoms of T2.7 are compressed by up to 5 %; the strain's curve goes on beyond.
bool promised(const json& c) {
  constexpr double kMostStrain = 0.05;
  return number(c.at("case").at("strain")) <= kMostStrain;
}

void add_calibration(const json& result, std::vector<Target>& targets) {
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const json& c : result.at("conditions"))
    for (const char* where : {"inside", "outside"}) {
      if (!promised(c)) continue;
      const double z = number(c.at("calibration").at(where).at("rms"));
      least = z >= least || std::isnan(least) ? least : z;  // one without a figure is a loss, too
      most = z <= most || std::isnan(most) ? most : z;
    }
  targets.push_back(
      {"1b. standardised errors' deviation, the least of all conditions", least, 0.8, "", false});
  targets.push_back({"1b. standardised errors' deviation, the most of all conditions", most, 1.2, ""});
}

// How ours stands to one peer at one condition, paired by seed.
struct Comparison {
  bool above = false, below = false;  // below: beyond the 95 % interval of the difference
};

// A method without a figure at a seed loses it: against a peer that has one by all of the peer's figure. When
// that is so at half of the seeds, ours is below whatever the interval, which is wide then.
Comparison compare(const json& ours, const json& peer, double edge_m) {
  const auto a = matched_over_seeds(ours, "snre", edge_m), b = matched_over_seeds(peer, "snre", edge_m);
  std::vector<double> differences;
  double lost = 0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    lost += std::isnan(a[k]) && std::isfinite(b[k]);
    differences.push_back((std::isfinite(a[k]) ? a[k] : 0) - (std::isfinite(b[k]) ? b[k] : 0));
  }
  const Interval d = interval95(differences);
  const bool loses = 2 * lost >= static_cast<double>(differences.size());
  return {d.mean > 0 && !loses, loses || d.mean + d.half_width < 0};
}

bool is_filter_point(const json& c) {
  return promised(c) && (on_curve(c, "strain") || on_curve(c, "snr") || on_curve(c, "correlation"));
}

// SNRe against strain, 0 where the image is lost; on beyond what is promised until it falls.
void add_band_pass(const json& result, std::vector<Target>& targets) {
  std::vector<std::pair<double, double>> curve;
  for (const json& c : result.at("conditions")) {
    if (!on_curve(c, "strain")) continue;
    auto snre = matched_over_seeds(default_of(c.at("methods")), "snre", result.at("edge_m"));
    for (double& s : snre) s = std::isfinite(s) ? s : 0;
    curve.emplace_back(c.at("case").at("strain"), interval95(snre).mean);
  }
  std::sort(curve.begin(), curve.end());
  double peak = kNan;
  for (const auto& [strain, snre] : curve) peak = std::fmax(peak, snre);
  targets.push_back(
      {"3. band pass: SNRe at the least strain over its peak", curve.front().second / peak, 0.5, ""});
  targets.push_back(
      {"3. band pass: SNRe at the largest strain over its peak", curve.back().second / peak, 0.999, ""});
}

void add_strain_filter(const json& result, std::vector<Target>& targets) {
  double points = 0, above = 0, below = 0;
  for (const json& c : result.at("conditions")) {
    if (!is_filter_point(c)) continue;
    const json& ours = default_of(c.at("methods"));
    bool above_all = true;
    for (const json& m : c.at("methods")) {
      if (m.at("ours").get<bool>()) continue;
      const Comparison with = compare(ours, m, result.at("edge_m"));
      above_all &= with.above;
      below += with.below;
    }
    ++points;
    above += above_all;
  }
  targets.push_back(
      {"3. points where SNRe at the same edge width is above every peer's", above / points, 0.8, "", false});
  targets.push_back({"3. points where a peer is above beyond the 95 % interval", below, 0, ""});
  add_band_pass(result, targets);
}

// Who has no valid node has lost; ours also where neither has one.
double error_ratio(double ours, double peer) {
  if (std::isnan(ours)) return std::numeric_limits<double>::infinity();
  return std::isnan(peer) ? 0 : ours / peer;
}

// Medians of ratios, seed by seed, over the conditions of the filter.
void add_speed(const json& result, std::vector<Target>& targets) {
  const json& methods = middle_of(result).at("methods");
  for (std::size_t m = 0; m < methods.size(); ++m) {
    if (methods[m].at("ours").get<bool>()) continue;
    std::vector<double> time, processor, error;
    for (const json& c : result.at("conditions")) {
      if (!is_filter_point(c)) continue;
      const json &ours = default_of(c.at("methods")).at("seeds"), &peer = c.at("methods")[m].at("seeds");
      for (std::size_t k = 0; k < ours.size(); ++k) {
        time.push_back(number(ours[k].at("seconds")) / number(peer[k].at("seconds")));
        processor.push_back(number(ours[k].at("processor_s")) / number(peer[k].at("processor_s")));
        error.push_back(error_ratio(number(ours[k].at("axial_rmse_m")), number(peer[k].at("axial_rmse_m"))));
      }
    }
    const std::string name = methods[m].at("method");
    targets.push_back({"6. displacement time over " + name + "'s", median_of(time), 1, ""});
    targets.push_back({"6. displacement processor time over " + name + "'s", median_of(processor), 1, ""});
    targets.push_back({"6. axial RMSE over " + name + "'s", median_of(error), 1, ""});
  }
}

void add_plane(const json& plane, std::vector<Target>& targets) {
  targets.push_back({"6. displacement, strain and direct modulus beside a touch stream, median",
                     1e3 * number(plane.at("direct").at("total_s").at("p50")), 150, "ms"});
  targets.push_back({"6. displacement, strain and iterative modulus beside a touch stream, median",
                     1e3 * number(plane.at("iterative").at("total_s").at("p50")), 450, "ms"});
}

// Where a method does not work any more, in the order of the questions.
std::string failure(const json& m, double edge_m) {
  const double valid = median_of(over_seeds(m, "valid_fraction")),
               hops = median_of(over_seeds(m, "hop_fraction"));
  if (!(hops <= 0.01)) return "hops to a wrong peak";
  if (!(valid >= 0.9)) return "loses correlation";
  std::vector<double> snre;
  for (const double s : matched_over_seeds(m, "snre", edge_m))
    if (std::isfinite(s)) snre.push_back(s);
  if (snre.empty()) return "is not as sharp as the edge width compared at";
  if (!(median_of(snre) >= 3)) return "SNRe below 3";
  return {};
}

}  // namespace

double number(const json& value) {
  return value.is_null() ? kNan : value.get<double>();
}

bool on_curve(const json& condition, const std::string& factor) {
  const json& factors = condition.at("factors");
  return std::find(factors.begin(), factors.end(), factor) != factors.end();
}

double at_edge(const json& method, const json& seed, const char* figure, double edge_m) {
  const json& edges = method.at("edges");
  for (std::size_t k = 0; k + 1 < edges.size(); ++k) {
    const double a = number(edges[k].at("axial_m")), b = number(edges[k + 1].at("axial_m"));
    if (!(a <= edge_m && edge_m < b)) continue;
    const double t = (edge_m - a) / (b - a);
    return std::exp((1 - t) * std::log(number(seed.at(figure)[k])) +
                    t * std::log(number(seed.at(figure)[k + 1])));
  }
  return kNan;
}

std::vector<double> over_seeds(const json& method, const char* figure) {
  std::vector<double> values;
  for (const json& seed : method.at("seeds"))
    if (const double v = number(seed.at(figure)); std::isfinite(v)) values.push_back(v);
  return values;
}

std::vector<double> matched_over_seeds(const json& method, const char* figure, double edge_m) {
  std::vector<double> values;
  for (const json& seed : method.at("seeds")) values.push_back(at_edge(method, seed, figure, edge_m));
  return values;
}

json failures(const json& result) {
  json out = json::array();
  for (const json& c : result.at("conditions"))
    for (const json& m : c.at("methods"))
      if (const std::string why = failure(m, result.at("edge_m")); !why.empty())
        out.push_back({{"method", m.at("method")}, {"case", c.at("case")}, {"why", why}});
  return out;
}

json without_figure(const json& result) {
  json out = json::array();
  for (const json& c : result.at("conditions"))
    for (const json& m : c.at("methods")) {
      const auto snre = matched_over_seeds(m, "snre", result.at("edge_m"));
      const auto none = std::count_if(snre.begin(), snre.end(), [](double s) { return std::isnan(s); });
      if (none > 0)
        out.push_back(
            {{"method", m.at("method")}, {"case", c.at("case")}, {"seeds", none}, {"of", snre.size()}});
    }
  return out;
}

std::vector<Target> elastography_targets(const json& result) {
  std::vector<Target> targets;
  add_rigid(result.at("rigid"), targets);
  add_calibration(result, targets);
  add_strain_filter(result, targets);
  add_modulus_targets(result.at("modulus"), targets);
  add_speed(result, targets);
  add_plane(result.at("stages").at("plane"), targets);
  return targets;
}

}  // namespace teletact::bench
