#include "client/commands/touch_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "client/session/figures.h"

namespace teletact::client {
namespace {

nlohmann::json quantiles(const Histogram& values_s) {
  return {
      {"p50", values_s.percentile(0.5)}, {"p99", values_s.percentile(0.99)}, {"max", values_s.percentile(1)}};
}

nlohmann::json spells(const SpellCounter& counter) {
  return {{"count", counter.count()}, {"s", counter.seconds()}};
}

// Share of the answers in contact, by the model that gave them: the contract's names, OTHER where it has
// none.
nlohmann::json solved_by(const std::map<v1::SolvePath, std::uint64_t>& answers) {
  std::uint64_t all = 0;
  for (const auto& [path, count] : answers) all += count;
  nlohmann::json shares = nlohmann::json::object();
  for (const auto& [path, count] : answers)
    shares[path == v1::SOLVE_PATH_UNSPECIFIED ? "OTHER"
                                              : v1::SolvePath_Name(path).substr(sizeof("SOLVE_PATH_") - 1)] =
        static_cast<double>(count) / static_cast<double>(all);
  return shares;
}

// Of the mean answer, by the contract's names.
nlohmann::json made_by(const TouchLinkStats& link) {
  nlohmann::json terms = nlohmann::json::object();
  for (const auto& [term, sum] : link.made_by)
    terms[v1::ForceError::Term_Name(term).substr(sizeof("TERM_") - 1)] =
        sum / static_cast<double>(link.force_budget.count());
  return terms;
}

// The largest, and what would make it smaller.
nlohmann::json largest_of(const TouchLinkStats& link) {
  const auto largest = largest_term(link.made_by);
  if (!largest) return nullptr;
  return {{"of", largest->what},
          {"by", largest->by / static_cast<double>(link.force_budget.count())},
          {"remedy", largest->remedy}};
}

}  // namespace

nlohmann::json to_json(const std::string& scene_id, const std::string& renderer,
                       const TouchSummary& summary) {
  const TickStatistics& ticks = summary.ticks;
  const TouchLinkStats& link = summary.link;
  nlohmann::json changes = nlohmann::json::array();
  for (const StateChange& change : ticks.changes()) {
    changes.push_back(
        {{"time_s", change.time_s}, {"state", name(change.state)}, {"reason", describe(change.reason)}});
  }
  return {
      {"scene", scene_id},
      {"renderer", renderer},
      {"device", summary.device},
      {"duration_s", ticks.duration_s()},
      {"enabled_s", ticks.enabled_s()},
      {"passes", summary.passes},
      {"touch_rate_hz", touch_rate_hz(link)},
      {"touch_latency_s", quantiles(link.latencies_s)},
      {"model_age_s", quantiles(ticks.model_age_s())},
      {"servo",
       {{"rate_hz", ticks.rate_hz()},
        {"ticks", ticks.ticks()},
        {"overruns", summary.overruns},
        {"lateness_s_p50", ticks.lateness_s().percentile(0.5)},
        {"lateness_s_p99", ticks.lateness_s().percentile(0.99)},
        {"lateness_s_max", ticks.lateness_s().percentile(1)},
        {"period_s", quantiles(ticks.period_s())},
        {"slack_s_min", ticks.slack_s().percentile(0)},
        {"scheduling", summary.real_time.text}}},
      {"by_law_share", ticks.by_law_share()},
      {"stalls", spells(ticks.stalls())},
      {"largest_force_n", ticks.largest_force_n()},
      {"degraded", spells(ticks.degraded())},
      {"service_degraded", spells(ticks.service_degraded())},
      {"faded", spells(ticks.faded())},
      {"largest_claim",
       {{"of", name(ticks.largest_claim().who)}, {"lacks_j", ticks.largest_claim().lacks_j}}},
      {"lost_s", ticks.lost_s()},
      {"states", changes},
      {"states_left_out", ticks.changes_left_out()},
      {"link",
       {{"poses", link.poses},
        {"answers", link.answers},
        {"distinct", link.distinct},
        {"not_covered", link.not_covered},
        {"failed", link.failed},
        {"preparing", link.preparing},
        {"degraded", link.degraded},
        {"dropped", link.dropped},
        {"rejected", summary.rejected_answers},
        {"streams", link.streams},
        {"service_instances", link.instances},
        {"period_s", link.period_s},
        {"round_trip_s", quantiles(link.round_trips_s)},
        {"clock_offset_s", link.clock_offset_s},
        {"clock_offset_error_s", link.clock_offset_error_s},
        {"layer_depth_m", link.layer_depth_m},
        {"largest_strain", link.largest_strain},
        {"solved_by", solved_by(link.solved_by)},
        {"force_budget",
         {{"answers", link.force_budget.count()},
          {"p50", link.force_budget.percentile(0.5)},
          {"p95", link.force_budget.percentile(0.95)},
          {"above", link.largest_above},
          {"made_by", made_by(link)},
          {"largest", largest_of(link)}}},
        {"law_pieces", link.law_pieces},
        {"tactile_images", link.tactile_images},
        {"tactile_dropped", link.tactile_dropped},
        {"laws_dropped", link.laws_dropped},
        {"last_version", link.last_version}}},
      {"telemetry_dropped", summary.telemetry_dropped},
      {"record_dropped", summary.record_dropped},
  };
}

void print_summary(const nlohmann::json& json) {
  const auto ms = [](const nlohmann::json& seconds) { return 1e3 * seconds.get<double>(); };
  const auto& latency = json["touch_latency_s"];
  const auto& servo = json["servo"];
  std::printf("touched scene %s for %.1f s, %u passes\n", json["scene"].get<std::string>().c_str(),
              json["enabled_s"].get<double>(), json["passes"].get<unsigned>());
  std::printf("  answers   %.0f /s with distinct poses, latency p50 %.2f ms, p99 %.2f ms, max %.2f ms\n",
              json["touch_rate_hz"].get<double>(), ms(latency["p50"]), ms(latency["p99"]),
              ms(latency["max"]));
  std::printf("  servo     %.1f Hz, %lu overruns (> 1 ms late), lateness p99 %.3f ms, max %.3f ms; %s\n",
              servo["rate_hz"].get<double>(), servo["overruns"].get<unsigned long>(),
              ms(servo["lateness_s_p99"]), ms(servo["lateness_s_max"]),
              servo["scheduling"].get<std::string>().c_str());
  const auto& link = json["link"];
  std::printf(
      "  link      round trip p50 %.2f ms, p99 %.2f ms; its clock is %+.3f ms from ours, to %.3f ms; age of "
      "what is felt p99 %.2f ms\n",
      ms(link["round_trip_s"]["p50"]), ms(link["round_trip_s"]["p99"]), ms(link["clock_offset_s"]),
      ms(link["clock_offset_error_s"]), ms(json["model_age_s"]["p99"]));
  const auto count = [&link](const char* name) { return link[name].get<unsigned long>(); };
  std::printf("  layer     %.4f m deep; largest strain under the finger %.2f\n",
              link["layer_depth_m"].get<double>(), link["largest_strain"].get<double>());
  if (const auto& solved_by = link["solved_by"]; !solved_by.empty()) {
    std::string shares;
    for (const auto& [path, share] : solved_by.items())
      shares += fmt::format("{}{} {:.1f} %", shares.empty() ? "" : ", ", path, 100 * share.get<double>());
    std::printf("  solved by %s of the answers in contact\n", shares.c_str());
  }
  if (const auto& budget = link["force_budget"]; budget["answers"].get<std::uint64_t>() > 0) {
    std::printf(
        "  budget    forces are within %.1f %% of the tissue's (median), %.1f %% (95 %% of the answers), by "
        "what the model states\n",
        100 * budget["p50"].get<double>(), 100 * budget["p95"].get<double>());
    if (const auto& largest = budget["largest"]; !largest.is_null())
      std::printf("            but for %s it would be %.1f %% of the force narrower: %s\n",
                  largest["of"].get<std::string>().c_str(), 100 * largest["by"].get<double>(),
                  largest["remedy"].get<std::string>().c_str());
    if (const double above = budget["above"].get<double>(); above > 0)
      std::printf("            tissue that stiffens with strain may push back up to %.0f %% harder still\n",
                  100 * above);
  }
  std::printf("  law       felt in %.1f %% of the contact, version %lu at last; %lu pieces, %lu malformed\n",
              100 * json["by_law_share"].get<double>(), count("last_version"), count("law_pieces"),
              count("laws_dropped"));
  std::printf("  stalls    %lu, %.3f s\n", json["stalls"]["count"].get<unsigned long>(),
              json["stalls"]["s"].get<double>());
  const auto spell = [&json](const char* name) {
    return fmt::format("{:.3f} s ({} times)", json[name]["s"].get<double>(),
                       json[name]["count"].get<unsigned long>());
  };
  std::printf(
      "  force     largest %.3f N; lost (PAUSED, FAULT) %.3f s, fading %s, DEGRADED %s; by the service %s\n",
      json["largest_force_n"].get<double>(), json["lost_s"].get<double>(), spell("faded").c_str(),
      spell("degraded").c_str(), spell("service_degraded").c_str());
  if (const auto& claim = json["largest_claim"]; claim["lacks_j"].get<double>() > 0)
    std::printf("  withheld  at most %.1f mJ: %s\n", 1e3 * claim["lacks_j"].get<double>(),
                claim["of"].get<std::string>().c_str());
  std::printf("  not good  of %lu answers %lu NOT_COVERED, %lu DEGRADED, %lu FAILED; %lu streams\n",
              count("answers"), count("not_covered"), count("degraded"), count("failed"), count("streams"));
}

}  // namespace teletact::client
