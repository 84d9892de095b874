// teletact-bench report: the --json of suites, made into pages for people (docs/results). Nobody types a
// figure.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "bench/suite.h"

namespace teletact::bench {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

// What is larger than this is for pictures and programs: it stays in the JSON.
constexpr std::size_t kMaxRows = 24, kMaxColumns = 10;

bool is_cell(const json& value) {
  return !value.is_structured();
}

// Flat: nothing within it but cells.
bool is_record(const json& value) {
  return value.is_object() && !value.empty() && value.size() <= kMaxColumns &&
         std::all_of(value.begin(), value.end(), is_cell);
}

std::string cell(const json& value) {
  if (value.is_number_float()) return fmt::format("{:.4g}", value.get<double>());
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_string()) return value.get<std::string>();
  return value.is_null() ? "-" : value.dump();
}

std::string words(std::string key) {
  std::replace(key.begin(), key.end(), '_', ' ');
  return key;
}

std::string row(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& text : cells) {
    line += ' ';
    for (const char c : text) line += c == '|' ? "\\|" : std::string(1, c);
    line += " |";
  }
  return line + "\n";
}

std::string head(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (std::size_t k = 0; k < cells.size(); ++k) line += "---|";
  return row(cells) + line + "\n";
}

// Records of the same kind: a column for each key that one of them has; `names`, where given, are a column
// before.
std::string table(const std::vector<const json*>& records, const std::vector<std::string>& names = {}) {
  std::vector<std::string> columns, keys;
  if (!names.empty()) columns.emplace_back();
  for (const json* record : records)
    for (const auto& [key, value] : record->items())
      if (std::find(keys.begin(), keys.end(), key) == keys.end())
        keys.push_back(key), columns.push_back(words(key));
  std::string text = head(columns);
  for (std::size_t k = 0; k < records.size(); ++k) {
    std::vector<std::string> cells;
    if (!names.empty()) cells.push_back(words(names[k]));
    for (const std::string& key : keys) cells.push_back(cell(records[k]->value(key, json())));
    text += row(cells);
  }
  return text;
}

std::string list(const json& record) {
  std::string text;
  for (const auto& [key, value] : record.items()) text += fmt::format("- {}: {}\n", words(key), cell(value));
  return text;
}

bool is_table(const json& value) {
  if (!value.is_structured() || value.empty() || value.size() > kMaxRows) return false;
  return std::all_of(value.begin(), value.end(), is_record);
}

// `value` under its heading, and what is within it, as far as it is small enough to be read.
void add(std::string& page, const std::string& title, const json& value) {
  if (is_table(value)) {
    std::vector<const json*> records;
    std::vector<std::string> names;
    for (const auto& [key, record] : value.items()) {
      records.push_back(&record);
      if (value.is_object()) names.push_back(key);
    }
    page += fmt::format("\n## {}\n\n{}", title, table(records, names));
    return;
  }
  if (!value.is_object()) return;
  json figures = json::object();
  for (const auto& [key, inner] : value.items())
    if (is_cell(inner)) figures[key] = inner;
  if (!figures.empty()) page += fmt::format("\n## {}\n\n{}", title, list(figures));
  for (const auto& [key, inner] : value.items())
    if (!is_cell(inner)) add(page, title + ", " + words(key), inner);
}

std::string promised(const json& promises) {
  std::string text = head({"promise", "measured", "promised", ""});
  for (const json& t : promises) {
    std::string unit = t.at("unit");
    unit = unit.empty() || unit == "1" ? "" : " " + unit;
    text += row({t.at("name"), cell(t.at("value")) + unit,
                 (t.at("at_most") ? "<= " : ">= ") + cell(t.at("target")) + unit,
                 t.at("met").get<bool>() ? "met" : "**not met**"});
  }
  return text;
}

// One Markdown page: when, where and of which version; what was promised and measured; the smaller tables of
// the result. Throws BenchError when it is not the result of a suite.
std::string results_page(const json& result) try {
  json rest = result;
  std::string page =
      fmt::format("# Results of `teletact-bench {}`\n\nWritten by `teletact-bench report`.\n\n",
                  result.at("suite").get<std::string>());
  page += list(result.at("machine"));
  if (result.value("quick", false)) page += "\n**A quick run: to see that it works, not to quote.**\n";
  if (!result.at("targets").empty()) page += "\n## Promised and measured\n\n" + promised(result["targets"]);
  for (const char* key : {"suite", "machine", "targets", "quick"}) rest.erase(key);
  json figures = json::object();
  for (const auto& [key, value] : rest.items())
    if (is_cell(value)) figures[key] = value;
  if (!figures.empty()) page += "\n## Settings and figures\n\n" + list(figures);
  for (const auto& [key, value] : rest.items())
    if (!is_cell(value)) add(page, words(key), value);
  return page;
} catch (const json::exception&) {
  throw BenchError("not the --json of a suite of this version");
}

json read(const std::string& file) {
  std::ifstream stream(file);
  if (!stream) throw BenchError("cannot read " + file);
  return json::parse(stream, nullptr, false);
}

void report(const std::vector<std::string>& files, const std::string& folder) {
  std::map<std::string, std::pair<std::string, std::string>> pages;  // by suite: the file, its page
  for (const std::string& file : files) {
    const json result = read(file);
    std::string page;
    try {
      page = results_page(result);
    } catch (const BenchError& e) {
      throw BenchError(file + ": " + e.what());
    }
    const std::string suite = result["suite"];
    const auto [first, is_new] = pages.try_emplace(suite, file, std::move(page));
    if (!is_new)
      throw BenchError(first->second.first + " and " + file + " are both of the suite " + suite +
                       ", which has one page: give one of them");
  }
  std::error_code error;
  fs::create_directories(folder, error);
  for (const auto& [suite, page] : pages) {
    const fs::path to = fs::path(folder) / (suite + ".md");
    if (!(std::ofstream(to) << page.second << std::flush)) throw BenchError("cannot write " + to.string());
    std::printf("%s\n", to.c_str());
  }
}

}  // namespace

void add_report_command(CLI::App& app) {
  struct Arguments {
    std::vector<std::string> files;
    std::string folder = "docs/results";
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand("report", "pages for people from the --json of suites");
  command.add_option("files", arguments->files, "results that suites wrote with --json")->required();
  command.add_option("--out", arguments->folder, "folder for the pages, one for each suite");
  command.callback([arguments] { report(arguments->files, arguments->folder); });
}

}  // namespace teletact::bench
