// The paper's Fig. 15 (T6.2): time to solve and to communicate one touch, against the size of the model: 51
// columns of nodes, 8 to 21 rows. Ours: a touch stream of the service itself over TCP on the loopback
// interface, closed loop at the stream's 1 kHz at most, so that 1 ms is the least. Theirs: Gaussian
// elimination of the whole system for each touch, over TCP; and GNU Octave, their solver, where it is
// installed (its solving alone).
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/own_scene.h"
#include "bench/peers/peer.h"
#include "bench/suites/paper/paper.h"
#include "bench/suites/paper/stack.h"
#include "bench/touch_client.h"
#include "client/link/channel.h"
#include "service/rpc/server.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kColumns = 51, kFewestRows = 8, kMaxRows = 21;
constexpr double kIndentationM = 0.001;
constexpr const char* kScene = "bench-fig15";
constexpr double kLatencyS = 0.005;       // 200 touches a second
constexpr double kFasterThanTheirs = 20;  // at the largest size

struct Ours {
  double model_s = 0, force_error = 0;
  Quantiles touch_s;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Ours, model_s, force_error, touch_s)
struct Theirs {
  double force_error = 0, touch_s = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Theirs, force_error, touch_s)
struct SizeFigures {
  std::size_t rows = 0, nodes = 0;
  Ours ours;
  Theirs theirs;
  double octave_s = 0;  // NaN without it
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(SizeFigures, rows, nodes, ours, theirs, octave_s)
struct Figures {
  std::size_t columns = kColumns;
  std::string octave{};  // why it is not measured
  std::vector<SizeFigures> rows{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, columns, octave, rows)

// The service in this process, on a free port of the loopback interface.
class LocalService {
 public:
  LocalService() {
    spdlog::set_level(spdlog::level::warn);  // a scene per size is no news
    service::ServerOptions options;
    options.listen.listen = "127.0.0.1:0";
    server_ = std::make_unique<service::Server>(std::vector{service::Device::open({})}, options);
    server_->make_ready();
    channel_ = client::make_channel(server_->address());
  }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  std::unique_ptr<service::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

Ours measure_ours(const LocalService& local, const ContactProblem& problem, bool quick) {
  Ours ours;
  ours.model_s =
      seconds_of([&] { create_own_scene(*v1::Palpation::NewStub(local.channel()), kScene, problem.tissue); });
  ours.force_error = check_against_reference(local.channel(), kScene, problem.tissue, kIndentationM);
  LoadOptions load;
  load.scene_id = kScene;
  load.begin_m = 0.02;
  load.end_m = 0.04;
  load.indentation_m = kIndentationM;
  load.duration_s = quick ? 0.2 : 1;
  ours.touch_s = quantiles(run_load(local.channel(), load, 0).latency_s);
  return ours;
}

Theirs measure_theirs(const ContactProblem& problem, bool quick) {
  const auto solver = make_dense_lu();
  solver->prepare(problem);
  PaperStack stack(*solver, problem);
  std::vector<double> seconds, solution;
  for (int n = 0; n < (quick ? 1 : 5); ++n)
    seconds.push_back(seconds_of([&] { solution = stack.touch(problem.pose.indentation_m); }));
  const double error = problem.force_error({solution[0], solution[1]});
  if (!(error <= 1e-6)) throw BenchError(fmt::format("fig15: their force is off by {:.3g}", error));
  return {error, median_of(seconds)};
}

SizeFigures measure_size(const LocalService& local, Peer* octave, std::size_t rows, bool quick) {
  const ContactProblem problem = make_problem(
      {.columns = kColumns, .rows = rows, .contrast = 5, .pattern = Pattern::kNodule, .contact_nodes = 3});
  SizeFigures size{rows, kColumns * rows, measure_ours(local, problem, quick), measure_theirs(problem, quick),
                   kNan};
  if (octave != nullptr) {
    octave->prepare(problem);
    size.octave_s = octave->touch(problem, 0).seconds;
  }
  std::printf("  %5zu  %8.3f  %9.1f  %9.1f  %9.1f\n", size.nodes, 1e3 * size.ours.touch_s.p50,
              1e3 * size.ours.model_s, 1e3 * size.theirs.touch_s, 1e3 * size.octave_s);
  return size;
}

Figures measure(bool quick, Promises& promises) {
  const LocalService local;
  Figures figures;
  const auto octave = make_octave(figures.octave);
  std::printf(
      "\nfig15: nodes, ours per touch (p50, ms), our model once (ms), theirs per touch (ms), Octave's "
      "solving "
      "(ms)\n");
  double slowest_s = 0, ratio = 0;
  for (std::size_t size = kFewestRows; size <= kMaxRows; size += quick ? 13 : 1) {
    figures.rows.push_back(measure_size(local, octave.get(), size, quick));
    const double ours_s = figures.rows.back().ours.touch_s.p50;
    slowest_s = std::max(slowest_s, ours_s);
    ratio = figures.rows.back().theirs.touch_s / ours_s;
  }
  if (!octave) std::printf("  %s\n", figures.octave.c_str());
  promises.push_back(
      {"solving_and_communicating_a_touch_p50_at_the_slowest_size", slowest_s, kLatencyS, "s"});
  promises.push_back({"papers_stack_over_ours_at_1071_nodes", ratio, kFasterThanTheirs, "times", false});
  return figures;
}

// The paper's form: time against the size; nodes, which is what it counts as degrees of freedom.
void draw(const Figures& figures, const std::filesystem::path& folder) {
  Curve theirs{.title = "the paper''s stack: Gaussian elimination, TCP",
               .style = "linespoints pt 6 lw 2 lc rgb 'black'"},
      ours{.title = "teletact, median", .style = "linespoints pt 7 lw 2 lc 1"},
      slow{.title = "teletact, 99 %", .style = "points pt 8 lc 1"},
      model{.title = "teletact, making the model (once per modulus)", .style = "lines dt 2 lc 2"},
      octave{.title = "Octave''s solving", .style = "linespoints pt 4 lc 3"};
  for (const SizeFigures& size : figures.rows) {
    const auto nodes = static_cast<double>(size.nodes);
    theirs.add(nodes, 1e3 * size.theirs.touch_s);
    ours.add(nodes, 1e3 * size.ours.touch_s.p50);
    slow.add(nodes, 1e3 * size.ours.touch_s.p99);
    model.add(nodes, 1e3 * size.ours.model_s);
    if (std::isfinite(size.octave_s)) octave.add(nodes, 1e3 * size.octave_s);
  }
  std::vector<Curve> curves{theirs, ours, slow, model};
  if (!octave.x.empty()) curves.push_back(octave);
  plot(folder / "fig15.png",
       script_of(curves, "set logscale y\nset key outside bottom center\n" +
                             axes("Solving and communicating one touch (the paper's Fig. 15)",
                                  "size of the model (nodes: 51 columns, 8 to 21 rows)", "time (ms)")));
}

}  // namespace

Part paper_fig15() {
  return make_part("fig15", measure, draw);
}

}  // namespace teletact::bench
