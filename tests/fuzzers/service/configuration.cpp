// The service's TOML file.
#include "service/operation/configuration.h"

#include "tests/fuzzers/service/fuzzers.h"

namespace teletact::fuzzers {

bool configuration(Bytes bytes) {
  static InputFile file;
  file.fill(bytes);
  service::ServeOptions options;
  options.config = file.path();
  const auto given = [](const std::string& flag) { return flag == "--state"; };
  if (!accepted<std::runtime_error>([&] { service::read_configuration(given, options); })) return false;
  require(options.server.state_directory.empty(), "the file wins over the command line");
  require(options.server.at_once <= service::kMostAtOnce, "more pairs at once than there may be");
  for (const service::LimitRow& row : service::limit_rows()) {
    const double value = row.value(options.server.limits);
    require(value == row.value({}) || (row.meaning && value >= row.min && value <= row.max),
            "a limit beyond its range");
  }
  return true;
}

}  // namespace teletact::fuzzers
