// teletact-bench report: the --json of suites, made into pages for people (docs/results). Nobody types a
// figure.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>

namespace teletact::bench {

// One Markdown page: when, where and of which version; what was promised and measured; the smaller tables of
// the result. Throws BenchError when it is not the result of a suite.
std::string results_page(const nlohmann::json& result);

void add_report_command(CLI::App& app);

}  // namespace teletact::bench
