#include "client/experiment/observer.h"

#include <algorithm>
#include <cctype>
#include <istream>
#include <memory>
#include <ostream>
#include <string>

namespace teletact::client {
namespace {

std::string read_word(std::istream& in) {
  std::string line;
  if (!std::getline(in, line)) return "q";
  const auto blank = [](unsigned char c) { return std::isspace(c) != 0; };
  line.erase(std::remove_if(line.begin(), line.end(), blank), line.end());
  for (char& c : line) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return line;
}

}  // namespace

Observer simulated_observer(const Weibull& function, std::uint64_t seed) {
  const auto random = std::make_shared<Random>(seed);
  return [=](const Trial& trial, std::size_t, std::size_t) -> std::optional<bool> {
    return random->happens(probability_harder(function, trial.stimulus_n_m));
  };
}

Observer terminal_observer(std::istream& in, std::ostream& out) {
  return [&in, &out](const Trial& trial, std::size_t number, std::size_t of) -> std::optional<bool> {
    out << "\ntrial " << number << " of " << of << ": present " << trial.background_n_m << " N/m, then "
        << trial.stimulus_n_m << " N/m\n";
    for (;;) {
      out << "is the second harder? y/n (q ends) " << std::flush;
      const std::string word = read_word(in);
      if (word == "y" || word == "yes") return true;
      if (word == "n" || word == "no") return false;
      if (word == "q" || word == "quit") return std::nullopt;
      out << "please answer y or n\n";
    }
  };
}

}  // namespace teletact::client
