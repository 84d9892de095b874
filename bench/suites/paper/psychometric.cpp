// The paper's psychophysics (T6.4): the fits of its Tables 2 and 3 beside its own figures, and what its
// method is worth: simulated observers whose Weber fraction is known, with perfect stiffness and through the
// whole chain, from late answers to the device.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>

#include "bench/stability/felt.h"
#include "bench/stability/parallel.h"
#include "bench/stability/servo_period.h"
#include "bench/suites/paper/paper.h"
#include "client/experiment/bootstrap.h"
#include "client/experiment/observer.h"

namespace teletact::bench {
namespace {

using namespace client;  // NOLINT: the experiment's words, throughout
using nlohmann::json;

constexpr double kBackgroundNM = 25;
constexpr double kDigit = 0.0005;  // half of the last digit that T6.4 states
constexpr double kCoverLeast = 0.92, kCoverMost = 0.98, kBiasMost = 0.01, kChainAddsMost = 0.05;
constexpr std::array<double, 3> kWeberFractions{0.1, 0.2, 0.4};

struct PaperTable {
  const char* name;
  const char* title;
  std::vector<StimulusCount> counts;
  double alpha_n_m, beta, weber_fraction;                    // reproduced independently (T6.4)
  double printed_alpha_n_m, printed_beta, printed_fraction;  // in the paper
};

const std::array<PaperTable, 2>& paper_tables() {
  static const std::array<PaperTable, 2> tables{
      {{"perfect_stiffness",
        "perfect stiffness (the paper''s Fig. 17)",
        {{27.5, 2, 8}, {30, 3, 6}, {32.5, 2, 3}, {35, 5, 2}, {37.5, 5, 0}},
        32.571,
        8.911,
        0.408,
        32.57,
        8.91,
        0.40},
       {"kalman",
        "Kalman filter (the paper''s Fig. 18)",
        {{27.5, 3, 2}, {30, 3, 2}, {32.5, 4, 1}, {35, 5, 0}, {37.5, 5, 0}},
        27.033,
        5.080,
        0.239,
        27.03,
        5.08,
        0.23}}};
  return tables;
}

json describe(const Interval& interval) {
  return json::array({interval.low, interval.high});
}

json fit_table(const std::vector<StimulusCount>& counts, FitMethod method, unsigned resamples) {
  const FitOptions how{method, 0};
  const Fit fit = fit_weibull(counts, how);
  json out{{"alpha_n_m", fit.function.alpha_n_m},
           {"beta", fit.function.beta},
           {"threshold_n_m", threshold_n_m(fit.function)},
           {"weber_fraction", weber_fraction(fit.function, kBackgroundNM)},
           {"at_limit", fit.at_limit}};
  if (fit.at_limit) return out;
  const BootstrapResult spread = bootstrap(counts, fit, how, kBackgroundNM, {resamples, 0.95, 1});
  out["interval"] = {{"alpha_n_m", describe(spread.alpha_n_m)},
                     {"beta", describe(spread.beta)},
                     {"weber_fraction", describe(spread.weber_fraction)},
                     {"resamples", resamples},
                     {"resamples_at_limit", spread.at_limit}};
  return out;
}

json fit_paper(const PaperTable& table, unsigned resamples, std::vector<Target>& targets) {
  json counts = json::array();
  for (const StimulusCount& c : table.counts)
    counts.push_back({{"stimulus_n_m", c.stimulus_n_m}, {"harder", c.harder}, {"not_harder", c.not_harder}});
  const json squares = fit_table(table.counts, FitMethod::kLeastSquares, resamples);
  const json likelihood = fit_table(table.counts, FitMethod::kMaximumLikelihood, resamples);
  const auto promise = [&](const char* what, const char* key, double expected, const char* unit) {
    targets.push_back({fmt::format("{}: {} off {:.3f}", table.name, what, expected),
                       std::abs(squares[key].get<double>() - expected), kDigit, unit});
  };
  promise("alpha", "alpha_n_m", table.alpha_n_m, "N/m");
  promise("beta", "beta", table.beta, "");
  promise("Weber fraction", "weber_fraction", table.weber_fraction, "");
  std::printf("%-18s alpha %.3f beta %.3f Weber fraction %.3f (paper %.2f, %.2f, %.2f)\n", table.name,
              squares["alpha_n_m"].get<double>(), squares["beta"].get<double>(),
              squares["weber_fraction"].get<double>(), table.printed_alpha_n_m, table.printed_beta,
              table.printed_fraction);
  return {{"name", table.name},
          {"title", table.title},
          {"answers", counts},
          {"least_squares", squares},
          {"maximum_likelihood", likelihood},
          {"paper",
           {{"alpha_n_m", table.printed_alpha_n_m},
            {"beta", table.printed_beta},
            {"weber_fraction", table.printed_fraction}}}};
}

struct Effort {
  unsigned experiments, resamples;
};

// What is felt of a stimulus (N/m): itself with perfect stiffness, else one of the passes through the chain.
using Feel = std::function<double(double stimulus_n_m, Random&)>;

double felt_perfectly(double stimulus_n_m, Random&) {
  return stimulus_n_m;
}

Feel felt_through(const FeltOptions& chain, const ExperimentPlan& plan) {
  constexpr unsigned kPasses = 40;
  std::map<double, std::vector<double>> felt;
  for (const double stimulus_n_m : plan.stimuli_n_m)
    felt[stimulus_n_m] = felt_stiffness(chain, plan.background_n_m, stimulus_n_m, kPasses);
  return [felt](double stimulus_n_m, Random& random) {
    const std::vector<double>& passes = felt.at(stimulus_n_m);
    return passes[static_cast<std::size_t>(random.uniform() * static_cast<double>(passes.size()))];
  };
}

// Judges what it feels.
Observer feeling_observer(const Weibull& function, const Feel& feel, std::uint64_t seed) {
  const auto random = std::make_shared<Random>(seed);
  return [=](const Trial& trial, std::size_t, std::size_t) -> std::optional<bool> {
    return random->happens(probability_harder(function, feel(trial.stimulus_n_m, *random)));
  };
}

// The same experiment by one observer, many times.
json observe(const ObserverDescription& observer, const FitOptions& how, const Effort& effort,
             const Feel& feel = felt_perfectly) {
  const Weibull truth = psychometric_function(observer, kBackgroundNM);
  Random random(1);
  const ExperimentPlan plan;
  unsigned covered = 0, unbounded = 0;
  double bias = 0, squares = 0;
  json estimates = json::array();
  for (unsigned k = 0; k < effort.experiments; ++k) {
    const auto trials = random_order(plan, random);
    const auto counts = count_answers(run_experiment(trials, feeling_observer(truth, feel, random.seed())));
    const Fit fit = fit_weibull(counts, how);
    const double error = weber_fraction(fit.function, kBackgroundNM) - observer.weber_fraction;
    bias += error / effort.experiments;
    squares += error * error / effort.experiments;
    if (fit.at_limit) {  // without an interval: not covered
      ++unbounded;
      continue;
    }
    const Interval interval =
        bootstrap(counts, fit, how, kBackgroundNM, {effort.resamples, 0.95, random.seed()}).weber_fraction;
    covered += interval.contains(observer.weber_fraction);
    estimates.push_back({error + observer.weber_fraction, interval.low, interval.high});
  }
  return {{"weber_fraction", observer.weber_fraction},
          {"lapse_rate", observer.lapse_rate},
          {"method", name_of(how.method)},
          {"lapse_rate_most", how.lapse_rate_most},
          {"coverage", static_cast<double>(covered) / effort.experiments},
          {"bias", bias},
          {"rms_error", std::sqrt(squares)},
          {"unbounded", unbounded},
          {"estimate_low_high", estimates}};
}

void print(const json& row) {
  std::printf("Weber fraction %.2f, lapse rate %.2f, %s%s: coverage %.3f, bias %+.4f, rms error %.4f\n",
              row["weber_fraction"].get<double>(), row["lapse_rate"].get<double>(),
              row["method"].get<std::string>().c_str(),
              row["lapse_rate_most"].get<double>() > 0 ? " with lapses" : "", row["coverage"].get<double>(),
              row["bias"].get<double>(), row["rms_error"].get<double>());
}

void promise(const json& row, std::vector<Target>& targets, const std::string& how = "") {
  const std::string name =
      fmt::format("simulated observer of {:.2f}, {}{}", row["weber_fraction"].get<double>(),
                  row["method"].get<std::string>(), how);
  targets.push_back(
      {name + ": interval covers the truth", row["coverage"], kCoverLeast, "of experiments", false});
  targets.push_back({name + ": interval covers the truth", row["coverage"], kCoverMost, "of experiments"});
  targets.push_back(
      {name + ": bias of the Weber fraction", std::abs(row["bias"].get<double>()), kBiasMost, ""});
}

// Promised without lapses, by both methods; told beside it: what lapses of 3 % do to a fit that knows of them
// and to one that does not.
json observe_all(const Effort& effort, std::vector<Target>& targets) {
  const ExperimentPlan plan;
  json rows = json::array();
  for (const double weber : kWeberFractions) {
    for (const FitMethod method : {FitMethod::kMaximumLikelihood, FitMethod::kLeastSquares}) {
      rows.push_back(observe({weber, 0, 0}, {method, 0}, effort));
      promise(rows.back(), targets);
      print(rows.back());
    }
  }
  const Effort fewer{std::min(effort.experiments, 200u), std::min(effort.resamples, 99u)};
  for (const double most : {0.0, 0.1}) {
    rows.push_back(observe({0.2, 0.03, 0}, {FitMethod::kMaximumLikelihood, most}, fewer));
    print(rows.back());
  }
  return {{"stimuli_n_m", plan.stimuli_n_m},          {"trials_per_stimulus", plan.trials_per_stimulus},
          {"experiments", effort.experiments},        {"resamples", effort.resamples},
          {"lapsing_experiments", fewer.experiments}, {"rows", rows}};
}

struct ChainCase {
  FeltOptions chain;
  std::string name;
  bool promised = false;
};

// At 100 Hz, answers 5 ms late (one machine) and 20 ms late (a network), over how sharp an inclusion's edges
// are; beside them the exact force at every tick, since wide edges leave no plateau whose contrast were the
// stimulus. Promised are edges of 1 and 1.5 mm where answers are 5 ms late, of 1.5 and 2 mm where they are 20
// ms late: sharper ones are overshot, softer ones felt softer. Told, at 1.5 mm: force alone, and few and late
// answers.
std::vector<ChainCase> chain_cases() {
  std::vector<ChainCase> all;
  for (const double edge_m : {0.0005, 0.001, 0.0015, 0.002, 0.003}) {
    all.push_back({{.renderer = "hold", .update_s = kServoS, .model_delay_s = 0, .edge_m = edge_m},
                   "exact force at every tick"});
    for (const double late_s : {0.005, 0.02})
      all.push_back(
          {{.model_delay_s = late_s, .edge_m = edge_m},
           fmt::format("through the chain, {:.0f} ms late", 1e3 * late_s),
           late_s < 0.01 ? edge_m >= 0.001 && edge_m <= 0.0015 : edge_m >= 0.0015 && edge_m <= 0.002});
  }
  all.push_back({{.renderer = "kalman-force"}, "force alone, 5 ms late"});
  all.push_back({{.update_s = 0.05, .model_delay_s = 0.1}, "20 Hz, 100 ms late"});
  return all;
}

json observe_chain(const Effort& effort, std::vector<Target>& targets) {
  const Effort fewer{std::min(effort.experiments, 300u), std::min(effort.resamples, 99u)};
  const std::vector<ChainCase> cases = chain_cases();
  std::vector<json> rows(cases.size() * kWeberFractions.size());
  in_parallel(rows.size(), [&](std::size_t n) {
    const ChainCase& one = cases[n / kWeberFractions.size()];
    const ObserverDescription observer{kWeberFractions[n % kWeberFractions.size()], 0, 0};
    rows[n] = observe(observer, {FitMethod::kMaximumLikelihood, 0}, one.promised ? effort : fewer,
                      felt_through(one.chain, ExperimentPlan()));
    rows[n].update({{"how", one.name},
                    {"promised", one.promised},
                    {"renderer", one.chain.renderer},
                    {"update_s", one.chain.update_s},
                    {"model_delay_s", one.chain.model_delay_s},
                    {"edge_m", one.chain.edge_m}});
  });
  for (const json& row : rows) {
    const std::string how =
        fmt::format(" {}, edges of {} mm", row["how"].get<std::string>(), 1e3 * row["edge_m"].get<double>());
    std::printf("%s: ", how.c_str());
    print(row);
    if (!row["promised"]) continue;
    promise(row, targets, how);
    targets.push_back({fmt::format("simulated observer of {:.2f},{}: the chain adds",
                                   row["weber_fraction"].get<double>(), how),
                       row["bias"], kChainAddsMost, ""});
  }
  return rows;
}

json measure(bool quick, std::vector<Target>& targets) {
  json fits = json::array();
  std::printf("\n");
  for (const PaperTable& table : paper_tables())
    fits.push_back(fit_paper(table, quick ? 200 : 2000, targets));
  const Effort effort = quick ? Effort{200, 59} : Effort{1000, 199};
  return {{"background_n_m", kBackgroundNM},
          {"fits", fits},
          {"observers", observe_all(effort, targets)},
          {"chain", observe_chain(effort, targets)}};
}

// The paper's form: shares as stars, the fitted curve; the threshold as a cross hair.
void draw_fit(const json& one, const std::filesystem::path& file) {
  std::string script = "$answers << EOD\n";
  for (const json& c : one["answers"])
    script +=
        fmt::format("{} {}\n", c["stimulus_n_m"].get<double>(),
                    c["harder"].get<double>() / (c["harder"].get<double>() + c["not_harder"].get<double>()));
  script += "EOD\n";
  const auto curve = [&](const char* name, const char* key) {
    script += fmt::format("{}(s) = 1 - 2**(-(s / {})**{})\n", name, one[key]["alpha_n_m"].get<double>(),
                          one[key]["beta"].get<double>());
  };
  curve("squares", "least_squares");
  curve("likelihood", "maximum_likelihood");
  curve("paper", "paper");
  const double threshold_n_m = one["least_squares"]["threshold_n_m"];
  script += fmt::format(
      "set arrow from {0},0 to {0},0.75 nohead dt 3\nset arrow from 25,0.75 to {0},0.75 nohead dt 3\n",
      threshold_n_m);
  script += fmt::format("set label 'Weber fraction {:.3f} (paper {:.2f})' at {},0.70 offset 1,0\n",
                        one["least_squares"]["weber_fraction"].get<double>(),
                        one["paper"]["weber_fraction"].get<double>(), threshold_n_m);
  plot(file,
       script + "set title 'Psychometric function, " + one["title"].get<std::string>() +
           "'\nset xlabel 'stimulus (N/m)'\nset ylabel 'probability of \"harder\"'\nset xrange [25:45]\n"
           "set yrange [0:1.05]\nset key bottom right\n"
           "plot paper(x) with lines lw 5 lc rgb '#bbbbbb' title 'the paper''s curve', "
           "squares(x) with lines lw 2 lc 1 title 'least squares (its method)', "
           "likelihood(x) with lines lw 2 dt 2 lc 2 title 'maximum likelihood', "
           "$answers with points pt 3 ps 2 lc rgb 'black' title 'answers'\n");
}

// Every experiment's interval, in the order of its estimate, about the truth.
void draw_observers(const json& observers, const std::filesystem::path& file) {
  std::string script =
      "set multiplot layout 1,3 title '95 % intervals of the Weber fraction, each by one simulated "
      "experiment (red: "
      "misses the truth)'\nset xlabel 'share of the experiments'\nset ylabel 'Weber fraction'\nset xrange "
      "[0:1]\nset xtics 0.5\nunset "
      "key\n";
  for (const json& row : observers["rows"]) {
    if (row["method"] != name_of(FitMethod::kMaximumLikelihood) || row["lapse_rate"] > 0) continue;
    std::vector<std::array<double, 3>> estimates = row["estimate_low_high"];
    std::sort(estimates.begin(), estimates.end());
    script += "$intervals << EOD\n";
    const double truth = row["weber_fraction"];
    for (std::size_t k = 0; k < estimates.size(); ++k) {
      const auto [estimate, low, high] = estimates[k];
      script += fmt::format("{} {} {} {} {}\n", (k + 0.5) / static_cast<double>(estimates.size()), estimate,
                            low, high - low, low <= truth && truth <= high ? "0xb0c4de" : "0xd62728");
    }
    script += fmt::format(
        "EOD\nset title '{0:.2f}: {1:.1f} % cover, bias {2:+.4f}'\nset yrange [0:{3}]\n"
        "plot $intervals using 1:3:(0):4:5 with vectors nohead lc rgb variable, $intervals using 1:2 with "
        "lines lw 2 "
        "lc rgb '#08306b', {0} with lines lw 2 lc rgb 'black'\n",
        truth, 100 * row["coverage"].get<double>(), row["bias"].get<double>(), 2.2 * truth);
  }
  plot(file, script + "unset multiplot\n");
}

void draw(const json& figures, const std::string& folder) {
  const std::filesystem::path into(folder);
  for (const json& one : figures["fits"])
    draw_fit(one, into / ("psychometric_" + one["name"].get<std::string>() + ".png"));
  draw_observers(figures["observers"], into / "psychometric_observers.png");
}

}  // namespace

PaperExperiment paper_psychometric() {
  return {"psychometric", measure, draw};
}

}  // namespace teletact::bench
