#include "client/experiment/person.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <istream>
#include <ostream>
#include <string>
#include <utility>

namespace teletact::client {
namespace {

// Without blanks, in small letters; q at the end of the input.
std::string read_word(std::istream& in) {
  std::string line;
  if (!std::getline(in, line)) return "q";
  const auto blank = [](unsigned char c) { return std::isspace(c) != 0; };
  line.erase(std::remove_if(line.begin(), line.end(), blank), line.end());
  for (char& c : line) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return line;
}

bool ends(const std::string& word) {
  return word == "q" || word == "quit";
}

enum class Felt { kFelt, kEnds, kLost };
// Lets the person feel one interval.
using Feel = std::function<Felt(double stiffness_n_m)>;

std::optional<bool> judge(const Trial& trial, const Feel& feel, std::istream& in, std::ostream& out) {
  double first = trial.background_n_m, second = trial.stimulus_n_m;
  if (trial.stimulus_first) std::swap(first, second);
  while (true) {
    out << "  the first. ";
    Felt felt = feel(first);
    if (felt == Felt::kFelt) {
      out << "  the second. ";
      felt = feel(second);
    }
    if (felt == Felt::kEnds) return std::nullopt;
    while (felt == Felt::kFelt) {
      out << "is the second harder? y/n (a: feel both again, q: end) " << std::flush;
      const std::string word = read_word(in);
      if (word == "y" || word == "yes") return !trial.stimulus_first;
      if (word == "n" || word == "no") return trial.stimulus_first;
      if (ends(word)) return std::nullopt;
      if (word == "a") break;
      out << "please answer y or n\n";
    }
  }
}

Felt feel_on(StimulusDisplay& display, double stiffness_n_m, double background_n_m, VoidTrials& voids,
             std::istream& in, std::ostream& out) {
  display.present(stiffness_n_m, background_n_m);
  const char* how = display.has_inclusion() ? "draw it to the right and back" : "stay for a moment";
  out << "Lift the finger, press it in, " << how << ", Enter when you have felt it: " << std::flush;
  while (true) {
    if (ends(read_word(in))) return Felt::kEnds;
    if (const std::string why = display.lost(); !why.empty()) {
      voids.add(why);
      out << "\n  this trial is void, and begins again: " << why << "\n";
      return Felt::kLost;
    }
    if (display.felt()) return Felt::kFelt;
    const std::string trouble = display.trouble();
    display.ask_for_force();
    out << "  not felt yet" << (trouble.empty() ? "" : " (" + trouble + ")")
        << ": lift the finger off, press it in and " << how << ", then Enter: " << std::flush;
  }
}

Felt feel_by_keys(double stiffness_n_m, double full_scale_n, std::istream& in, std::ostream& out) {
  constexpr double kStepM = 0.0005;
  constexpr int kBar = 60;
  out << "Type + to press deeper and - to lift, as often as you like, then Enter; Enter alone goes on.\n";
  double depth_m = 0;
  bool pressed = false;
  while (true) {
    const double force_n = stiffness_n_m * depth_m;
    const int filled = std::clamp(static_cast<int>(std::lround(kBar * force_n / full_scale_n)), 0, kBar);
    out << "  depth " << 1e3 * depth_m << " mm, force |" << std::string(static_cast<std::size_t>(filled), '#')
        << std::string(static_cast<std::size_t>(kBar - filled), ' ') << "| " << std::flush;
    const std::string word = read_word(in);
    if (ends(word)) return Felt::kEnds;
    if (word.empty() && pressed) return Felt::kFelt;
    const auto steps = std::count(word.begin(), word.end(), '+') - std::count(word.begin(), word.end(), '-');
    depth_m = std::clamp(depth_m + kStepM * static_cast<double>(steps), 0.0, kKeyboardDeepestM);
    pressed = pressed || depth_m > 0;
    if (!pressed) out << "  press first\n";
  }
}

}  // namespace

Observer device_observer(StimulusDisplay& display, std::istream& in, std::ostream& out) {
  return [&](const Trial& trial, std::size_t number, std::size_t of) {
    out << "\ntrial " << number << " of " << of << '\n';
    VoidTrials voids;
    return judge(
        trial, [&](double k_n_m) { return feel_on(display, k_n_m, trial.background_n_m, voids, in, out); },
        in, out);
  };
}

Observer keyboard_observer(std::istream& in, std::ostream& out, double full_scale_n) {
  return [&in, &out, full_scale_n](const Trial& trial, std::size_t number, std::size_t of) {
    out << "\ntrial " << number << " of " << of << '\n';
    return judge(
        trial, [&](double k_n_m) { return feel_by_keys(k_n_m, full_scale_n, in, out); }, in, out);
  };
}

}  // namespace teletact::client
