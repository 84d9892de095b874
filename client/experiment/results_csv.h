// The answers of an experiment as comma-separated values, one trial a line in the order they were asked:
//
//   # teletact experiment: seed 7, ...      any number of lines that begin with '#'
//   trial,background_n_m,stimulus_n_m,harder,condition,first
//   1,25,32.5,1,kalman at 100 Hz 5 ms late,background
//
// harder: the stimulus. A file without the last column has the background first, one without the last two is
// of perfect stiffness: all that there was then.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "client/experiment/trials.h"

namespace teletact::client {

// Writes every answer as it comes, so that an experiment that breaks off keeps what was answered.
class ResultsCsv {
 public:
  // Throws std::runtime_error when the file exists already and is not one that broke off before the first
  // answer (answers of a person cannot be had again), or cannot be written. `remark`: one line; as a trial's
  // condition, which has no comma either.
  ResultsCsv(const std::filesystem::path&, const std::string& remark);
  // Goes on in a file that has so many answers. Throws std::runtime_error when it cannot, as where it has not
  // all columns.
  static ResultsCsv going_on(const std::filesystem::path&, std::size_t answered);
  // Throws std::runtime_error when it could not be written.
  void add(const AnsweredTrial&);

 private:
  ResultsCsv() = default;
  void require_written(const std::string& remedy) const;
  std::filesystem::path path_;
  std::ofstream file_;
  std::size_t trials_ = 0;
};

// The seed that the remark of an experiment states, if one does.
std::optional<std::uint64_t> seed_of_results_csv(const std::filesystem::path&);

// Throws std::runtime_error naming the file and the line that is not as above.
std::vector<AnsweredTrial> read_results_csv(const std::filesystem::path&);

}  // namespace teletact::client
