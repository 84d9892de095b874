// The paper's Fig. 15 (T6.2): time to solve and to communicate one touch, against the size of the model: 51
// columns of nodes, 8 to 21 rows. Ours: a touch stream of the service itself over TCP on the loopback
// interface, closed loop at the
// stream's 1 kHz at most, so that 1 ms is the least. Theirs: Gaussian elimination of the whole system for
// each touch, over TCP; and GNU Octave, their solver, where it is installed (its solving alone).
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "bench/own_scene.h"
#include "bench/peers/peer.h"
#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/stack.h"
#include "bench/touch_client.h"
#include "client/link/channel.h"
#include "service/rpc/server.h"

namespace teletact::bench {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kColumns = 51, kFewestRows = 8, kMostRows = 21;
constexpr double kIndentationM = 0.001;
constexpr const char* kScene = "bench-fig15";
constexpr double kLatencyS = 0.005;       // 200 touches a second
constexpr double kFasterThanTheirs = 20;  // at the largest size

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.at(values.size() / 2);
}

// The service in this process, on a free port of the loopback interface.
class LocalService {
 public:
  LocalService() {
    spdlog::set_level(spdlog::level::warn);  // a scene per size is no news
    service::ServerOptions options;
    options.listen.listen = "127.0.0.1:0";
    server_ = std::make_unique<service::Server>(service::Device::open({}), options);
    server_->make_ready();
    channel_ = client::make_channel(server_->address(), "");
  }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  std::unique_ptr<service::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

json measure_ours(const LocalService& local, const ContactProblem& problem, bool quick) {
  const Clock::time_point begin = Clock::now();
  create_own_scene(*v1::Palpation::NewStub(local.channel()), kScene, problem.tissue);
  const double model_s = seconds_since(begin);
  const double error = check_against_reference(local.channel(), kScene, problem.tissue, kIndentationM);
  LoadOptions load;
  load.scene_id = kScene;
  load.begin_m = 0.02;
  load.end_m = 0.04;
  load.indentation_m = kIndentationM;
  load.duration_s = quick ? 0.2 : 1;
  const LoadResult result = run_load(local.channel(), load, 0);
  return {{"model_s", model_s}, {"force_error", error}, {"touch_s", quantiles(result.latency_s)}};
}

json measure_theirs(const ContactProblem& problem, bool quick) {
  const auto solver = make_dense_lu();
  solver->prepare(problem);
  PaperStack stack(*solver, problem);
  std::vector<double> seconds;
  double error = 0;
  for (int n = 0; n < (quick ? 1 : 5); ++n) {
    const Clock::time_point begin = Clock::now();
    const std::vector<double> solution = stack.touch(problem.pose.indentation_m);
    seconds.push_back(seconds_since(begin));
    error = problem.force_error({solution[0], solution[1]});
  }
  if (!(error <= 1e-6)) throw BenchError(fmt::format("fig15: their force is off by {:.3g}", error));
  return {{"force_error", error}, {"touch_s", median(seconds)}};
}

json measure_size(const LocalService& local, Peer* octave, std::size_t rows, bool quick) {
  const ContactProblem problem = make_problem(
      {.columns = kColumns, .rows = rows, .contrast = 5, .pattern = Pattern::kNodule, .contact_nodes = 3});
  json row{{"rows", rows},
           {"nodes", kColumns * rows},
           {"ours", measure_ours(local, problem, quick)},
           {"theirs", measure_theirs(problem, quick)}};
  if (octave != nullptr) {
    octave->prepare(problem);
    row["octave_s"] = octave->touch(problem, 0).seconds;
  }
  std::printf("  %5zu  %8.3f  %9.1f  %9.1f", kColumns * rows,
              1e3 * row["ours"]["touch_s"]["p50"].get<double>(), 1e3 * row["ours"]["model_s"].get<double>(),
              1e3 * row["theirs"]["touch_s"].get<double>());
  if (octave != nullptr) std::printf("  %9.1f", 1e3 * row["octave_s"].get<double>());
  std::printf("\n");
  return row;
}

json measure(bool quick, std::vector<Target>& targets) {
  const LocalService local;
  std::string absent;
  const auto octave = make_octave(absent);
  std::printf("\nfig15: nodes, ours per touch (p50, ms), our model once (ms), theirs per touch (ms)%s\n",
              octave ? ", Octave's solving (ms)" : "");
  json rows = json::array();
  double slowest_s = 0, ratio = 0;
  for (std::size_t size = kFewestRows; size <= kMostRows; size += quick ? 13 : 1) {
    rows.push_back(measure_size(local, octave.get(), size, quick));
    const double ours_s = rows.back()["ours"]["touch_s"]["p50"];
    slowest_s = std::max(slowest_s, ours_s);
    ratio = rows.back()["theirs"]["touch_s"].get<double>() / ours_s;
  }
  if (!absent.empty()) std::printf("  %s\n", absent.c_str());
  targets.push_back({"fig15: solve and communication at every size, p50", slowest_s, kLatencyS, "s"});
  targets.push_back(
      {"fig15: the paper's stack over ours at 1071 nodes", ratio, kFasterThanTheirs, "times", false});
  return {{"columns", kColumns}, {"octave", absent.empty() ? "measured" : absent}, {"rows", rows}};
}

// The paper's form: time against the size; nodes, which is what it counts as degrees of freedom.
void draw(const json& figures, const std::string& folder) {
  std::string script = "$time << EOD\n";
  bool octave = false;
  for (const json& row : figures["rows"]) {
    octave = row.contains("octave_s");
    script += fmt::format(
        "{} {} {} {} {} {}\n", row["nodes"].get<int>(), 1e3 * row["ours"]["touch_s"]["p50"].get<double>(),
        1e3 * row["ours"]["touch_s"]["p99"].get<double>(), 1e3 * row["theirs"]["touch_s"].get<double>(),
        1e3 * row["ours"]["model_s"].get<double>(), octave ? 1e3 * row["octave_s"].get<double>() : 0);
  }
  plot(std::filesystem::path(folder) / "fig15.png",
       script +
           "EOD\nset title 'Solving and communicating one touch (the paper''s Fig. 15)'\nset logscale y\n"
           "set xlabel 'size of the model (nodes: 51 columns, 8 to 21 rows)'\nset ylabel 'time (ms)'\n"
           "set key outside bottom center\n"
           "plot $time using 1:4 with linespoints pt 6 lw 2 lc rgb 'black' title 'the paper''s stack: "
           "Gaussian "
           "elimination, TCP', $time using 1:2 with linespoints pt 7 lw 2 lc 1 title 'teletact, median', "
           "$time using 1:3 with points pt 8 lc 1 title 'teletact, 99 %', $time using 1:5 with lines dt 2 lc "
           "2 "
           "title 'teletact, making the model (once per modulus)'" +
           (octave ? ", $time using 1:6 with linespoints pt 4 lc 3 title 'Octave''s solving'" : "") + "\n");
}

}  // namespace

PaperExperiment paper_fig15() {
  return {"fig15", measure, draw};
}

}  // namespace teletact::bench
