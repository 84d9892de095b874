// A scripted person at a simulated device, and at the keyboard: judged is what was felt, and nothing tells.
#include "client/experiment/person.h"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <streambuf>
#include <thread>

#include "client/experiment/observer.h"
#include "client/experiment/spring_display.h"
#include "client/haptic/simulated_device.h"

namespace teletact::client {
namespace {

// Lines that are thought of only when they are read.
class Answering final : public std::streambuf {
 public:
  explicit Answering(std::function<std::string()> next) : next_(std::move(next)) {}

 private:
  int_type underflow() override {
    line_ = next_() + "\n";
    setg(line_.data(), line_.data(), line_.data() + line_.size());
    return traits_type::to_int_type(line_.front());
  }
  std::function<std::string()> next_;
  std::string line_;
};

// The simulated device and hand, and what stiffness a finger on it feels: force written over indentation.
class FeelingDevice final : public HapticDevice {
 public:
  explicit FeelingDevice(const SimulatedDeviceOptions& options) : device_(options) {}
  const DeviceProfile& profile() const noexcept override { return device_.profile(); }
  void open() override { device_.open(); }
  void close() noexcept override { device_.close(); }
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override {
    const bool ok = device_.read(now_ns, reading) && !lost;
    if (without_button) reading.resume_pressed = false;
    indentation_m_ = reading.pose.position_m.y();
    x_m_ = reading.pose.position_m.x();
    return ok;
  }
  bool write(const Vector3& force_n) noexcept override {
    force_n_ = force_n.norm();
    if (indentation_m_ > 0.003) {
      felt_n_m = -force_n.y() / indentation_m_;
      if (x_m_ < 0.012) beside_n_m = -force_n.y() / indentation_m_;
      if (std::abs(x_m_ - kInclusionCentreM) < 0.003) inside_n_m = -force_n.y() / indentation_m_;
    }
    return device_.write(force_n);
  }
  // Ticks with the force on and a pressed finger that feels nothing.
  void show(const OperatorView& view) noexcept override {
    if (view.force_on && indentation_m_ > 0.0005 && force_n_ == 0) ++ticks_without_force;
    device_.show(view);
  }
  std::atomic<double> felt_n_m{0}, beside_n_m{0}, inside_n_m{0};
  std::atomic<int> ticks_without_force{0};
  std::atomic<bool> lost{false}, without_button{false};

 private:
  SimulatedDevice device_;
  double indentation_m_ = 0, x_m_ = 0;
  double force_n_ = 0;
};

SimulatedDeviceOptions simulated() {
  SimulatedDeviceOptions options;
  options.profile = device_profile("premium-1.5");
  options.hand.approach_m_s = 0.1;
  return options;
}

// What is asked after `begin` of all that was said.
bool asks(const std::ostringstream& out, const std::string& question) {
  const std::string said = out.str();
  return said.size() >= question.size() &&
         said.find(question, said.size() - std::min<std::size_t>(said.size(), 90)) != std::string::npos;
}

// A person who feels these trials and judges rightly.
void expect_judged(FeelingDevice& device, SpringDisplay& display, const std::vector<Trial>& trials) {
  std::ostringstream out;
  double last_n_m = 0, first_n_m = 0;
  std::vector<double> felt_n_m;
  Answering person([&]() -> std::string {
    if (asks(out, "is the second harder?")) return last_n_m > first_n_m ? "y" : "n";
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (!display.felt() && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    first_n_m = last_n_m;
    felt_n_m.push_back(last_n_m = device.felt_n_m);
    return "";
  });
  std::istream in(&person);
  const auto answers = run_experiment(trials, device_observer(display, in, out));
  ASSERT_EQ(answers.size(), trials.size());
  ASSERT_EQ(felt_n_m.size(), 2 * trials.size());
  for (std::size_t k = 0; k < trials.size(); ++k) {
    const auto& [background, stimulus, condition, first] = trials[k];
    EXPECT_EQ(answers[k].harder, stimulus > background) << "the stimulus, whichever is felt first";
    EXPECT_NEAR(felt_n_m[2 * k + (first ? 1 : 0)], background, 0.05 * background);
    EXPECT_NEAR(felt_n_m[2 * k + (first ? 0 : 1)], stimulus, 0.05 * stimulus);
  }
  for (const char* stiffness : {"25", "31", "19", "27", "29", "21", "N/m"})
    EXPECT_EQ(out.str().find(stiffness), std::string::npos) << out.str();
}

using Chain = std::optional<SpringChain>;

// What is felt takes its time: each by a person of its own, all at once.
void with_each(const std::vector<Chain>& chains, const std::function<void(const Chain&)>& felt) {
  std::vector<std::thread> persons;
  for (const Chain& chain : chains) persons.emplace_back(felt, chain);
  for (std::thread& person : persons) person.join();
}

TEST(Person, AtADeviceJudgesWhatWasFeltAndIsNotTold) {
  const auto judge = [](const std::vector<Trial>& trials) {
    with_each({Chain(), SpringChain()}, [&](const Chain& chain) {
      SCOPED_TRACE(condition_of(chain));
      FeelingDevice device(simulated());
      SpringDisplay display(device, false, chain);
      expect_judged(device, display, trials);
    });
  };
  std::thread meanwhile(judge, std::vector<Trial>{{25, 27}, {25, 21, "", true}});
  judge({{25, 31}, {25, 19}, {25, 29, "", true}});
  meanwhile.join();
}

bool felt_within(const SpringDisplay& display, double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!display.felt() && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return display.felt();
}

// GIVEN answers every 50 ms that are 100 ms late WHEN the finger arrives THEN the model that was told before
// is there at once, as perfect stiffness is.
TEST(Person, ThroughTheWholeChainFeelsWhatWasForeseenAtOnce) {
  with_each({Chain(), SpringChain{20, 0.1}}, [](const Chain& chain) {
    FeelingDevice device(simulated());
    SpringDisplay display(device, false, chain);
    display.present(25);
    EXPECT_TRUE(felt_within(display, 15));
    EXPECT_LE(device.ticks_without_force, 20) << condition_of(chain);
  });
}

TEST(Person, AnInclusionIsFeltWhereItIsAndTheBackgroundBesideIt) {
  with_each({Chain(), SpringChain()}, [](const Chain& chain) {
    FeelingDevice device(simulated());
    SpringDisplay display(device, false, chain, {.width_m = 0.02});
    display.present(37, 25);
    EXPECT_TRUE(felt_within(display, 15));
    // a pass from end to end more
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(700);
    while (std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_NEAR(device.inside_n_m, 37, 0.08 * 37) << condition_of(chain);
    EXPECT_NEAR(device.beside_n_m, 25, 0.08 * 25) << condition_of(chain);
  });
}

TEST(Person, AnImpossibleChainIsRefused) {
  FeelingDevice device(simulated());
  for (const SpringChain& chain : {SpringChain{0, 0.005}, SpringChain{NAN, 0.005}, SpringChain{100, -0.001},
                                   SpringChain{100, 0.4}, SpringChain{100, NAN}})
    EXPECT_THROW(SpringDisplay(device, false, chain), std::invalid_argument) << condition_of(chain);
  for (const SpringPlace& place :
       {SpringPlace{0.005}, SpringPlace{NAN}, SpringPlace{0.1}, SpringPlace{0.02, 0}})
    EXPECT_THROW(SpringDisplay(device, false, {}, place), std::invalid_argument) << condition_of({}, place);
  EXPECT_EQ(condition_of({}), "perfect");
  EXPECT_EQ(condition_of({}, {.width_m = 0.02}), "perfect on an inclusion of 20 mm with edges of 1.5 mm");
  EXPECT_EQ(condition_of(SpringChain{62.5, 0.02}), "kalman at 62.5 Hz 20 ms late");
}

TEST(Person, AfterAFaultForceComesBackOnlyWhenItIsAskedFor) {
  FeelingDevice device(simulated());
  device.without_button = true;
  SpringDisplay display(device, false);
  display.present(25);
  ASSERT_TRUE(felt_within(display, 10));
  device.lost = true;
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  device.lost = false;
  display.present(31);
  EXPECT_FALSE(felt_within(display, 1.2));  // longer than it takes otherwise
  EXPECT_NE(display.trouble(), "");
  display.ask_for_force();
  EXPECT_TRUE(felt_within(display, 10));
}

TEST(Person, NoAnswerIsTakenForWhatWasNotFelt) {
  SimulatedDeviceOptions options = simulated();
  options.hand.approach_m_s = 1e-6;  // a hand that never gets down
  FeelingDevice device(options);
  SpringDisplay display(device, false);
  std::istringstream in("\n\nq\n");
  std::ostringstream out;
  EXPECT_TRUE(run_experiment({{25, 30}}, device_observer(display, in, out)).empty());
  EXPECT_NE(out.str().find("not felt yet"), std::string::npos);
  EXPECT_EQ(out.str().find("is the second harder?"), std::string::npos);
}

TEST(Person, AStimulusBeyondTheDeviceIsRefused) {
  FeelingDevice device(simulated());
  SpringDisplay display(device, false);
  EXPECT_THROW(display.present(1.01 * device.profile().limits().largest_stiffness_n_m),
               std::invalid_argument);
  EXPECT_THROW(display.present(NAN), std::invalid_argument);
}

// Stiffness that is felt at once, as it is; now and then one that is lost.
class ListedDisplay final : public StimulusDisplay {
 public:
  void present(double stiffness_n_m, double) override {
    if (++presented > 1000) throw DisplayLost("gone");
    presented_n_m = stiffness_n_m;
  }
  bool has_inclusion() const noexcept override { return false; }
  bool felt() const noexcept override { return true; }  // long enough before it was lost
  double felt_n_m() const override { return presented_n_m; }
  std::string trouble() const override { return ""; }
  void ask_for_force() noexcept override {}
  std::string lost() const override { return is_lost(presented) ? "the cat is on it" : ""; }
  unsigned presented = 0;
  double presented_n_m = 0;
  std::function<bool(unsigned)> is_lost = [](unsigned) { return false; };
};

std::vector<Trial> some_trials() {
  Random random(3);
  ExperimentPlan plan;
  plan.counterbalanced = true;
  plan.trials_per_stimulus = 6;
  return random_order(plan, random);
}

std::vector<bool> judgements(const std::vector<AnsweredTrial>& answers) {
  std::vector<bool> out;
  for (const AnsweredTrial& answer : answers) out.push_back(answer.harder);
  return out;
}

// GIVEN one seed THEN who touches what is as it is said to be judges as who is told, whatever is lost
// between, and who goes on as who never ended.
TEST(Observer, WhoTouchesJudgesAsWhoIsTold) {
  const Weibull function = psychometric_function({}, 25);
  const std::vector<Trial> trials = some_trials();
  const auto told = run_experiment(trials, simulated_observer(function, 11));
  const std::atomic<bool> stop{false};
  std::ostringstream out;
  ListedDisplay display;
  display.is_lost = [](unsigned presented) { return presented % 5 == 3; };
  const auto touched = run_experiment(trials, touching_observer(display, function, 11, stop, out));
  EXPECT_EQ(judgements(touched), judgements(told));
  EXPECT_GT(display.presented, 2 * trials.size());
  EXPECT_NE(out.str().find("void, and felt again from the first on: the cat is on it"), std::string::npos);
  for (const bool touches : {false, true}) {
    std::vector<AnsweredTrial> earlier(told.begin(), told.begin() + 17);
    const auto going_on = run_experiment(
        trials,
        touches ? touching_observer(display, function, 11, stop, out) : simulated_observer(function, 11), {},
        earlier);
    EXPECT_EQ(judgements(going_on), judgements(told)) << touches;
  }
}

TEST(Observer, EndsWithTheDisplayAndWhenItIsToldTo) {
  const Weibull function = psychometric_function({}, 25);
  const std::vector<Trial> trials = some_trials();
  std::ostringstream out;
  std::atomic<bool> stop{false};
  ListedDisplay display;
  unsigned kept = 0;
  const auto record = [&](const AnsweredTrial&) { stop = ++kept == 7; };
  EXPECT_EQ(run_experiment(trials, touching_observer(display, function, 11, stop, out), record).size(), 7u);
  stop = false;
  display.is_lost = [](unsigned presented) { return presented > 20; };
  kept = 0, display.presented = 0;
  EXPECT_THROW(run_experiment(trials, touching_observer(display, function, 11, stop, out),
                              [&](const AnsweredTrial&) { ++kept; }),
               DisplayLost);
  EXPECT_EQ(kept, 10u);
  EXPECT_EQ(display.presented, 23u) << "three tries of the eleventh";
}

TEST(Observer, TouchesASpringAsItIs) {
  const auto touch = [](double stimulus_n_m) {
    FeelingDevice device(simulated());
    SpringDisplay display(device, false);
    const std::atomic<bool> stop{false};
    std::ostringstream out;
    const auto observer = touching_observer(display, weibull_through(26, 60), 1, stop, out);
    EXPECT_EQ(judgements(run_experiment({{25, stimulus_n_m}}, observer)),
              std::vector<bool>{stimulus_n_m > 25});
    EXPECT_NEAR(display.felt_n_m(), stimulus_n_m, 0.5);
  };
  std::thread harder(touch, 30);
  touch(20);
  harder.join();
}

// The question is of the second, the answer that is kept of the stimulus.
TEST(Person, NoMeansTheFirstIsTheHarderOne) {
  for (const bool stimulus_first : {false, true}) {
    ListedDisplay display;
    std::istringstream in("\n\ny\n\n\nn\n\n\nYES\n\n\nno\n");
    std::ostringstream out;
    const std::vector<Trial> trials(4, {25, 30, "", stimulus_first});
    EXPECT_EQ(judgements(run_experiment(trials, device_observer(display, in, out))),
              stimulus_first ? (std::vector<bool>{false, true, false, true})
                             : (std::vector<bool>{true, false, true, false}));
  }
}

TEST(Person, IsAskedAgainWhatWasLost) {
  ListedDisplay display;
  display.is_lost = [](unsigned presented) { return presented == 2; };
  std::istringstream in("\n\n\n\ny\n");
  std::ostringstream out;
  EXPECT_EQ(judgements(run_experiment({{25, 30}}, device_observer(display, in, out))),
            std::vector<bool>{true});
  EXPECT_NE(out.str().find("this trial is void, and begins again: the cat is on it"), std::string::npos);
  display.is_lost = [](unsigned) { return true; };
  std::istringstream patient("\n\n\n\n\n\n");
  EXPECT_THROW(run_experiment({{25, 30}}, device_observer(display, patient, out)), DisplayLost);
}

// Presses both by 8 mm and counts the bar.
TEST(Person, AtTheKeyboardSeesForceAndNoStiffness) {
  std::ostringstream out;
  int pressed = 0;
  std::vector<std::ptrdiff_t> bars;
  Answering person([&]() -> std::string {
    const std::string said = out.str();
    if (asks(out, "is the second harder?"))
      return bars.at(bars.size() - 1) > bars.at(bars.size() - 2) ? "Y" : "n";
    if (++pressed % 2 == 1) return "++++++++ ++++++++";
    bars.push_back(
        std::count(said.begin() + static_cast<std::ptrdiff_t>(said.rfind("force |")), said.end(), '#'));
    return "";
  });
  std::istream in(&person);
  const auto answers =
      run_experiment({{25, 30}, {25, 20}}, keyboard_observer(in, out, 30 * kKeyboardDeepestM));
  ASSERT_EQ(answers.size(), 2u);
  EXPECT_TRUE(answers[0].harder);
  EXPECT_FALSE(answers[1].harder);
  EXPECT_EQ(bars, (std::vector<std::ptrdiff_t>{40, 48, 40, 32}));
  for (const char* stiffness : {"25", "30", "20", "N/m"})
    EXPECT_EQ(out.str().find(stiffness), std::string::npos) << out.str();
}

TEST(Person, AsksAgainFeelsAgainAndEndsWithTheInput) {
  std::istringstream in("\n+\n\n+\n\nmaybe\na\n+\n\n+\n\nn\n+\n");
  std::ostringstream out;
  const auto answers = run_experiment({{25, 30}, {25, 20}, {25, 40}}, keyboard_observer(in, out, 1));
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_FALSE(answers[0].harder);
  EXPECT_NE(out.str().find("press first"), std::string::npos);
  EXPECT_NE(out.str().find("please answer y or n"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
