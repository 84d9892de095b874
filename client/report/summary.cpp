#include "client/report/summary.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "client/servo/tick_statistics.h"

namespace teletact::client {
namespace {

using nlohmann::json;

// Promised in the project's acceptance, for two processor cores.
constexpr double kWindowS = 0.5, kTouchLatencyS = 0.010;
constexpr double kTouchRateHz = 200, kCheckRateHz = 18;  // of answers that are felt; that check a contact law
constexpr double kForceMedian = 0.10, kForceP95 = 0.30, kForceCoverage = 0.90;
constexpr double kMinContrast = 3, kMinDiameterM = 0.008, kDeepestM = 0.025;
constexpr double kOverrunS = 0.001;

json quantiles(std::vector<double> values, const char* middle_name, double middle) {
  if (values.empty()) throw std::runtime_error("nothing was recorded that could be summarised");
  return {{"p50", percentile(values, 0.5)},
          {middle_name, percentile(values, middle)},
          {"max", percentile(values, 1)}};
}

void require_answers(const TouchRecord& touch) {
  if (touch.answers.empty()) throw std::runtime_error("the touch recording holds no answers");
}

// Windows published between the first and the last touch answer.
std::vector<AcquiredWindow> while_touching(const AcquireRecord& acquire, const TouchRecord& touch) {
  require_answers(touch);
  std::vector<AcquiredWindow> windows;
  for (const AcquiredWindow& window : acquire.windows)
    if (window.published_s >= touch.answers.front().arrived_s &&
        window.published_s <= touch.answers.back().arrived_s)
      windows.push_back(window);
  return windows;
}

json window_figures(const AcquireRecord& acquire, const TouchRecord& touch) {
  std::vector<AcquiredWindow> windows = while_touching(acquire, touch);
  const std::size_t count = windows.size();
  if (windows.empty()) windows = acquire.windows;  // all were acquired beforehand
  std::vector<double> compute_s, request_s;
  for (const AcquiredWindow& window : windows) {
    compute_s.push_back(window.received_to_published_s);
    request_s.push_back(window.request_s);
  }
  return {{"windows", acquire.windows.size()},
          {"windows_while_touching", count},
          {"window_s", quantiles(compute_s, "p95", 0.95)},
          {"window_request_s", quantiles(request_s, "p95", 0.95)}};
}

// Answers to a pose at another place than the answer before; a resting finger counts once.
std::size_t distinct_poses(const std::vector<TouchAnswerTime>& answers) {
  std::size_t distinct = answers.empty() ? 0 : 1;
  for (std::size_t k = 1; k < answers.size(); ++k)
    distinct += answers[k].x_m != answers[k - 1].x_m || answers[k].y_m != answers[k - 1].y_m ||
                answers[k].z_m != answers[k - 1].z_m;
  return distinct;
}

// How often, and how long in all, while force was on; null where the recording does not say.
json spells(const TouchRecord& touch, std::optional<bool> TouchTick::*what) {
  SpellCounter counter;
  for (const TouchTick& tick : touch.ticks) {
    if (!(tick.*what)) return nullptr;
    counter.add(tick.time_s, tick.enabled && *(tick.*what));
  }
  return {{"count", counter.count()}, {"s", counter.seconds()}};
}

// Of energy, that was refused; null where the recording does not say.
json largest_claim(const TouchRecord& touch) {
  EnergyLedger::Refused largest;
  for (const TouchTick& tick : touch.ticks) {
    if (!tick.refused) return nullptr;
    if (tick.refused->lacks_j > largest.lacks_j) largest = *tick.refused;
  }
  return {{"of", name(largest.who)}, {"lacks_j", largest.lacks_j}};
}

// Of the time with force on; 0 where the recording does not say.
double by_law_share(const TouchRecord& touch) {
  std::size_t enabled = 0, by_law = 0;
  for (const TouchTick& tick : touch.ticks) {
    enabled += tick.enabled;
    by_law += tick.enabled && tick.by_law.value_or(false);
  }
  return enabled > 0 ? static_cast<double>(by_law) / static_cast<double>(enabled) : 0;
}

double round_trip_s(const TouchRecord& touch) {
  std::vector<double> known_s;
  for (const TouchTick& tick : touch.ticks)
    if (tick.round_trip_s > 0) known_s.push_back(tick.round_trip_s);
  return known_s.empty() ? 0 : percentile(known_s, 0.5);
}

json touch_figures(const TouchRecord& touch) {
  require_answers(touch);
  std::vector<double> latency_s;
  for (const TouchAnswerTime& answer : touch.answers) latency_s.push_back(answer.latency_s);
  const std::size_t distinct = distinct_poses(touch.answers);
  const double span_s = touch.answers.back().arrived_s - touch.answers.front().arrived_s;
  SpellCounter stalls(kStallS);
  for (const TouchTick& tick : touch.ticks) stalls.add(tick.time_s, tick.at_border);
  return {{"touch_rate_hz", span_s > 0 ? static_cast<double>(distinct - 1) / span_s : 0},
          {"touch_latency_s", quantiles(latency_s, "p99", 0.99)},
          {"round_trip_s", round_trip_s(touch)},
          {"by_law_share", by_law_share(touch)},
          {"stalls", {{"count", stalls.count()}, {"s", stalls.seconds()}}},
          {"degraded", spells(touch, &TouchTick::degraded)},
          {"service_degraded", spells(touch, &TouchTick::service_degraded)},
          {"faded", spells(touch, &TouchTick::faded)},
          {"largest_claim", largest_claim(touch)},
          {"answers",
           {{"count", touch.answers.size()},
            {"distinct_poses", distinct},
            {"not_covered", touch.not_covered},
            {"degraded", touch.degraded},
            {"failed", touch.failed}}}};
}

json servo_figures(const TouchRecord& touch) {
  std::vector<double> lateness_s;
  for (const TouchTick& tick : touch.ticks) lateness_s.push_back(tick.lateness_s);
  const double span_s = touch.ticks.back().time_s - touch.ticks.front().time_s;
  const auto overruns =
      std::count_if(lateness_s.begin(), lateness_s.end(), [](double s) { return s > kOverrunS; });
  return {{"rate_hz", span_s > 0 ? static_cast<double>(touch.ticks.size() - 1) / span_s : 0},
          {"overruns", overruns},
          {"lateness_s_p99", percentile(lateness_s, 0.99)}};
}

// Whether a window was acquired over its middle; so it is where the recording does not say.
bool acquired(const Inclusion& truth, const AcquireRecord& acquire) {
  if (!acquire.scene) return true;
  const auto& windows = acquire.scene->windows();
  return std::any_of(windows.begin(), windows.end(), [&](const v1::Window& window) {
    return truth.x_m >= window.covers().begin_x_m() && truth.x_m <= window.covers().end_x_m();
  });
}

json inclusion_json(const Inclusion& truth, const AcquireRecord& acquire, const InclusionReport& report,
                    int match) {
  json out{{"position_m", {truth.x_m, truth.y_m}},
           {"diameter_m", truth.diameter_m},
           {"contrast", truth.contrast},
           {"acquired", match >= 0 || acquired(truth, acquire)},
           {"found", match >= 0}};
  if (match < 0) return out;
  const FoundInclusion& found = report.found[static_cast<std::size_t>(match)];
  out["found_contrast"] = found.contrast;
  out["distance_m"] = std::hypot(truth.x_m - found.x_m, truth.y_m - found.y_m);
  return out;
}

json inclusion_figures(const Tissue& tissue, const AcquireRecord& acquire, const InclusionReport& report) {
  json truth = json::array(), found = json::array(), spurious = json::array();
  std::size_t missed = 0;
  for (std::size_t t = 0; t < tissue.inclusions.size(); ++t) {
    const Inclusion& inclusion = tissue.inclusions[t];
    truth.push_back(inclusion_json(inclusion, acquire, report, report.match[t]));
    const bool promised = inclusion.contrast >= kMinContrast && inclusion.diameter_m >= kMinDiameterM &&
                          inclusion.y_m - inclusion.diameter_m / 2 <= kDeepestM;
    missed += promised && truth.back()["acquired"].get<bool>() && report.match[t] < 0;
  }
  const auto as_json = [](const FoundInclusion& f) {
    return json{{"position_m", {f.x_m, f.y_m}}, {"diameter_m", f.diameter_m}, {"contrast", f.contrast}};
  };
  for (const FoundInclusion& f : report.found) found.push_back(as_json(f));
  for (const std::size_t f : report.spurious) spurious.push_back(as_json(report.found[f]));
  return {{"true", truth},
          {"found", found},
          {"false", spurious},
          {"missed", missed},
          {"background_pa", report.background_pa},
          {"true_background_pa", tissue.youngs_modulus_pa}};
}

json device_figures(const AcquireRecord& acquire) {
  if (!acquire.info) return nullptr;
  const v1::Device& device = acquire.info->device();
  return {{"name", device.name()},
          {"vendor", device.vendor()},
          {"platform", device.platform()},
          {"driver_version", device.driver_version()},
          {"has_double", device.has_double()},
          {"compute_units", device.compute_units()}};
}

// After the true contrast: the found one and how far off it lies.
std::string found_or_missed(const json& truth) {
  if (!truth["acquired"].get<bool>()) return "not acquired";
  if (!truth["found"].get<bool>()) return "MISSED";
  return fmt::format("{:.1f} (true / found), {:.1f} mm off", truth["found_contrast"].get<double>(),
                     1e3 * truth["distance_m"].get<double>());
}

std::string readable_inclusions(const json& inclusions) {
  const auto mm = [](const json& metres) { return 1e3 * metres.get<double>(); };
  std::string out;
  for (const json& truth : inclusions["true"])
    out +=
        fmt::format("inclusion     x {:5.1f} mm, y {:4.1f} mm, diameter {:4.1f} mm: contrast {:.1f} / {}\n",
                    mm(truth["position_m"][0]), mm(truth["position_m"][1]), mm(truth["diameter_m"]),
                    truth["contrast"].get<double>(), found_or_missed(truth));
  for (const json& wrong : inclusions["false"])
    out +=
        fmt::format("inclusion     x {:5.1f} mm, y {:4.1f} mm, contrast {:.1f}: INVENTED\n",
                    mm(wrong["position_m"][0]), mm(wrong["position_m"][1]), wrong["contrast"].get<double>());
  return out;
}

}  // namespace

ModulusGrid measured_modulus(const AcquireRecord& record) {
  if (!record.scene || record.scene->youngs_modulus().grid().size_size() < 2)
    throw std::runtime_error("the acquire recording holds no final scene; was it cut short?");
  const v1::Map& map = record.scene->youngs_modulus();
  ModulusGrid grid;
  grid.nx = map.grid().size(0);
  grid.ny = map.grid().size(1);
  grid.x0_m = map.grid().origin_m(0);
  grid.y0_m = map.grid().origin_m(1);
  grid.dx_m = map.grid().spacing_m(0);
  grid.dy_m = map.grid().spacing_m(1);
  grid.pa.resize(grid.nx * grid.ny);
  const std::string& valid = record.scene->valid().values().data();
  if (map.values().dtype() != v1::DATA_TYPE_FLOAT32 || map.values().data().size() != 4 * grid.pa.size() ||
      valid.size() != grid.pa.size())
    throw std::runtime_error("the scene's modulus map does not fill its grid");
  std::copy_n(map.values().data().data(), map.values().data().size(),
              reinterpret_cast<char*>(grid.pa.data()));
  for (std::size_t k = 0; k < grid.pa.size(); ++k)
    if (valid[k] == 0) grid.pa[k] = std::numeric_limits<float>::quiet_NaN();
  return grid;
}

json summarise(const Tissue& tissue, const TouchRecord& touch, const AcquireRecord& acquire,
               const ForceError& force, const InclusionReport& inclusions,
               const std::string& client_version) {
  json summary = summarise(touch, client_version);
  summary.update(window_figures(acquire, touch));
  summary["force_error"] = {{"median", force.median},
                            {"p95", force.p95},
                            {"coverage", force.coverage},
                            {"samples", force.judged},
                            {"excluded", "the start ramp of the force, and true forces of 0.05 N or less"}};
  summary["inclusions"] = inclusion_figures(tissue, acquire, inclusions);
  summary["device"] = device_figures(acquire);
  summary["versions"]["service"] = acquire.info ? json(acquire.info->build()) : json(nullptr);
  summary["versions"]["api"] = acquire.info ? json(acquire.info->api_version()) : json(nullptr);
  set_targets(summary, promises_of(summary));
  return summary;
}

json summarise(const TouchRecord& touch, const std::string& client_version) {
  json summary = touch_figures(touch);
  summary["servo"] = servo_figures(touch);
  summary["tactile"] = {{"images", touch.tactile.size()}, {"malformed", touch.malformed_images}};
  summary["versions"] = {{"client", client_version}, {"grpc", grpc::Version()}, {"compiler", __VERSION__}};
  set_targets(summary, promises_of(summary));
  return summary;
}

bool set_targets(json& summary, const std::vector<Promise>& promises) {
  json& targets = summary["targets"] = json::array();
  for (const Promise& promise : promises)
    targets.push_back({{"name", promise.name},
                       {"value", promise.value},
                       {"target", promise.target},
                       {"unit", promise.unit},
                       {"met", promise.met()}});
  return std::all_of(promises.begin(), promises.end(), [](const Promise& p) { return p.met(); });
}

std::vector<Promise> promises_of(const json& s) {
  const Promise stalls{"stalls", s.at("stalls").at("count").get<double>(), 0, "1"};
  if (!s.contains("windows")) return {stalls};
  const json& inclusions = s.at("inclusions");
  const double by_law = s.at("by_law_share").get<double>();
  const double rate_hz = by_law * kCheckRateHz + (1 - by_law) * kTouchRateHz;
  const double beyond_s =
      s.at("touch_latency_s").at("p99").get<double>() - s.at("round_trip_s").get<double>();
  return {
      stalls,
      {"window_s p95", s.at("window_s").at("p95").get<double>(), kWindowS, "s"},
      {"touch_rate_hz", s.at("touch_rate_hz").get<double>(), rate_hz, "Hz", false},
      {"touch_latency_s p99 beyond the round trip", beyond_s, kTouchLatencyS, "s"},
      {"inclusions missed", inclusions.at("missed").get<double>(), 0, "1"},
      {"inclusions invented", static_cast<double>(inclusions.at("false").size()), 0, "1"},
      {"force_error median", s.at("force_error").at("median").get<double>(), kForceMedian, "1"},
      {"force_error p95", s.at("force_error").at("p95").get<double>(), kForceP95, "1"},
      {"force_error coverage", s.at("force_error").at("coverage").get<double>(), kForceCoverage, "1", false}};
}

std::string readable(const json& s) {
  const auto ms = [](const json& seconds) { return 1e3 * seconds.get<double>(); };
  const auto percent = [](const json& share) { return 100 * share.get<double>(); };
  const json &latency = s["touch_latency_s"], &servo = s["servo"], &tactile = s["tactile"];
  const std::string stalls =
      fmt::format("{} stalls, {:.3f} s", s["stalls"]["count"].get<int>(), s["stalls"]["s"].get<double>());
  std::string out;
  if (s.contains("windows")) {
    const json &window = s["window_s"], &request = s["window_request_s"];
    out += fmt::format(
        "windows       {} published, {} of them while touching; {}\n"
        "window        received to published p50 {:.0f} ms, p95 {:.0f} ms, max {:.0f} ms; asked for to "
        "published p95 {:.0f} ms\n",
        s["windows"].get<int>(), s["windows_while_touching"].get<int>(), stalls, ms(window["p50"]),
        ms(window["p95"]), ms(window["max"]), ms(request["p95"]));
  } else {
    out += fmt::format("stalls        {}\n", stalls);
  }
  out += fmt::format(
      "touch         {:.0f} answers/s over a round trip of {:.2f} ms; latency p50 {:.2f} ms, p99 {:.2f} ms, "
      "max {:.2f} ms; {:.0f} % by a contact law\n"
      "servo         {:.1f} Hz, {} overruns, lateness p99 {:.3f} ms\n",
      s["touch_rate_hz"].get<double>(), ms(s["round_trip_s"]), ms(latency["p50"]), ms(latency["p99"]),
      ms(latency["max"]), percent(s["by_law_share"]), servo["rate_hz"].get<double>(),
      servo["overruns"].get<int>(), ms(servo["lateness_s_p99"]));
  if (tactile["images"].get<int>() + tactile["malformed"].get<int>() > 0)
    out += fmt::format("tactile       {} images, {} malformed and left out\n", tactile["images"].get<int>(),
                       tactile["malformed"].get<int>());
  if (s.contains("force_error"))
    out += fmt::format("force error   median {:.1f} %, p95 {:.1f} %, over {:.1f} % of the path\n",
                       percent(s["force_error"]["median"]), percent(s["force_error"]["p95"]),
                       percent(s["force_error"]["coverage"]));
  return out + (s.contains("inclusions") ? readable_inclusions(s["inclusions"]) : "");
}

std::string not_met(const json& s) {
  std::string out;
  for (const json& target : s["targets"])
    if (!target["met"].get<bool>())
      out += fmt::format("NOT MET       {}: {:.4g} instead of {:.4g} {}\n", target["name"].get<std::string>(),
                         target["value"].get<double>(), target["target"].get<double>(),
                         target["unit"].get<std::string>() == "1" ? "" : target["unit"].get<std::string>());
  return out;
}

}  // namespace teletact::client
