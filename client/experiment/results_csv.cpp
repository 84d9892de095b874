#include "client/experiment/results_csv.h"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string_view>

namespace teletact::client {
namespace {

const std::string kPerfectHeader = "trial,background_n_m,stimulus_n_m,harder";
const std::string kBackgroundFirstHeader = kPerfectHeader + ",condition";
const std::string kHeader = kBackgroundFirstHeader + ",first";
constexpr const char* kPlace = "give one in a folder of yours that has room";

// Which was felt first.
constexpr std::string_view kStimulus = "stimulus", kBackground = "background";

// Reads one number and what ends it; false when there is none.
template <typename T>
bool take(const char*& at, const char* end, char closing, T& value) {
  const auto [after, error] = std::from_chars(at, end, value);
  if (error != std::errc()) return false;
  at = after;
  if (closing == '\0') return at == end;
  return at != end && *at++ == closing;
}

bool parse(const std::string& line, const std::string& header, std::size_t number, AnsweredTrial& answer) {
  const char* at = line.data();
  const char* end = at + line.size();
  std::size_t trial = 0;
  int harder = -1;
  if (!take(at, end, ',', trial) || !take(at, end, ',', answer.trial.background_n_m) ||
      !take(at, end, ',', answer.trial.stimulus_n_m))
    return false;
  if (header == kPerfectHeader) {
    if (!take(at, end, '\0', harder)) return false;
  } else {
    if (!take(at, end, ',', harder)) return false;
    std::string_view rest(at, end);
    if (header == kHeader) {
      const std::size_t comma = rest.rfind(',');
      if (comma == std::string_view::npos) return false;
      const std::string_view first = rest.substr(comma + 1);
      if (first != kStimulus && first != kBackground) return false;
      answer.trial.stimulus_first = first == kStimulus;
      rest = rest.substr(0, comma);
    }
    answer.trial.condition = rest;
    if (answer.trial.condition.empty() || answer.trial.condition.find(',') != std::string::npos) return false;
  }
  answer.harder = harder == 1;
  const auto stiffness = [](double value) { return value > 0 && std::isfinite(value); };
  return trial == number && (harder == 0 || harder == 1) && stiffness(answer.trial.background_n_m) &&
         stiffness(answer.trial.stimulus_n_m);
}

// Remarks and the header alone: nothing is lost with it.
bool holds_no_answer(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line) && line.rfind("# teletact experiment:", 0) == 0) continue;
  return line == kHeader && !std::getline(file, line);
}

bool has_all_columns(const std::filesystem::path& path) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);)
    if (!line.empty() && line.front() != '#') return line == kHeader || line == kHeader + '\r';
  return false;
}

bool ends_a_line(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::ate | std::ios::binary);
  file.seekg(-1, std::ios::end);
  return file.get() == '\n';
}

}  // namespace

ResultsCsv::ResultsCsv(const std::filesystem::path& path, const std::string& remark) : path_(path) {
  if (std::filesystem::exists(path) && !holds_no_answer(path))
    throw std::runtime_error(path.string() + " already exists; give another name");
  errno = 0;
  file_.open(path);
  file_.precision(std::numeric_limits<double>::max_digits10);
  file_ << "# " << remark << '\n' << kHeader << '\n' << std::flush;
  require_written(kPlace);
}

ResultsCsv ResultsCsv::going_on(const std::filesystem::path& path, std::size_t answered) {
  if (!has_all_columns(path))
    throw std::runtime_error(path.string() + ": expected the line " + kHeader + "; begin a new file");
  ResultsCsv csv;
  csv.path_ = path, csv.trials_ = answered;
  errno = 0;
  csv.file_.open(path, std::ios::app);
  csv.file_.precision(std::numeric_limits<double>::max_digits10);
  if (!ends_a_line(path)) csv.file_ << '\n';
  csv.require_written(kPlace);
  return csv;
}

void ResultsCsv::add(const AnsweredTrial& answer) {
  errno = 0;
  file_ << ++trials_ << ',' << answer.trial.background_n_m << ',' << answer.trial.stimulus_n_m << ','
        << answer.harder << ',' << answer.trial.condition << ','
        << (answer.trial.stimulus_first ? kStimulus : kBackground) << '\n'
        << std::flush;
  require_written("the answers before trial " + std::to_string(trials_) + " are kept");
}

void ResultsCsv::require_written(const std::string& remedy) const {
  if (!file_)
    throw std::runtime_error("cannot write " + path_.string() + " (" + std::strerror(errno) + "): " + remedy);
}

std::optional<std::uint64_t> seed_of_results_csv(const std::filesystem::path& path) {
  const std::string before = "# teletact experiment: seed ";
  std::ifstream file(path);
  for (std::string line; std::getline(file, line) && line.rfind('#', 0) == 0;) {
    std::uint64_t seed = 0;
    const char* const end = line.data() + line.size();
    if (line.rfind(before, 0) == 0 &&
        std::from_chars(line.data() + before.size(), end, seed).ec == std::errc())
      return seed;
  }
  return std::nullopt;
}

std::vector<AnsweredTrial> read_results_csv(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  std::vector<AnsweredTrial> answers;
  std::string header;  // once it was read
  std::size_t number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line.front() == '#') continue;
    AnsweredTrial answer;
    const bool good = header.empty()
                          ? line == kHeader || line == kBackgroundFirstHeader || line == kPerfectHeader
                          : parse(line, header, answers.size() + 1, answer);
    if (!good)
      throw std::runtime_error(path.string() + ", line " + std::to_string(number) + ": expected " +
                               (header.empty()
                                    ? "the line " + kHeader
                                    : "trial " + std::to_string(answers.size() + 1) + " as " + header));
    if (header.empty())
      header = line;
    else
      answers.push_back(answer);
  }
  if (header.empty()) throw std::runtime_error(path.string() + ": expected the line " + kHeader);
  return answers;
}

}  // namespace teletact::client
