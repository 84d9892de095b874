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

// Larger tables are for pictures and programs. They stay in the JSON, and so do these keys.
constexpr std::size_t kMaxRows = 24, kMaxColumns = 10;
constexpr const char* kForPrograms[] = {"all", "lifts", "processor_s", "product", "seconds"};
// Columns that tell rows apart come first.
constexpr const char* kNamingKeys[] = {"row",   "name",   "stage",     "group",
                                       "model", "kernel", "precision", "pairs_of"};
// From this many on, promises of one kind share a row.
constexpr std::size_t kMinOfAKind = 3;

bool is_left_out(const std::string& key) {
  return std::find(std::begin(kForPrograms), std::end(kForPrograms), key) != std::end(kForPrograms);
}

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
// before. A column that is the same in each row becomes a line above the table.
std::string table(const std::vector<const json*>& records, const std::vector<std::string>& names = {}) {
  std::vector<std::string> keys;
  for (const json* record : records)
    for (const auto& [key, value] : record->items())
      if (!is_left_out(key) && std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
  const auto place = [](const std::string& key) {
    return std::find(std::begin(kNamingKeys), std::end(kNamingKeys), key) - std::begin(kNamingKeys);
  };
  std::stable_sort(keys.begin(), keys.end(),
                   [&place](const auto& a, const auto& b) { return place(a) < place(b); });
  std::string common;
  std::vector<std::string> heading;
  std::vector<std::vector<std::string>> rows(records.size());
  if (!names.empty()) {
    heading.emplace_back();
    for (std::size_t k = 0; k < names.size(); ++k) rows[k].push_back(words(names[k]));
  }
  for (const std::string& key : keys) {
    std::vector<std::string> cells;
    for (const json* record : records) cells.push_back(cell(record->value(key, json())));
    const auto is_first = [&cells](const std::string& text) { return text == cells.front(); };
    if (cells.size() > 2 && std::all_of(cells.begin(), cells.end(), is_first)) {
      if (!cells.front().empty())
        common += (common.empty() ? "In each row: " : ", ") + words(key) + " " + cells.front();
      continue;
    }
    heading.push_back(words(key));
    for (std::size_t k = 0; k < cells.size(); ++k) rows[k].push_back(cells[k]);
  }
  if (!common.empty()) common += ".\n";
  if (heading.empty()) return common;
  std::string text = (common.empty() ? "" : common + "\n") + head(heading);
  for (const auto& cells : rows) text += row(cells);
  return text;
}

bool is_table(const json& value) {
  if (!value.is_structured() || value.empty() || value.size() > kMaxRows) return false;
  return std::all_of(value.begin(), value.end(), is_record);
}

// `value` and what is within it, as far as it is small enough to be read: a line for the figures of each
// object, a table under its heading for records.
void add(std::string& lines, std::string& tables, const std::string& title, const json& value) {
  if (is_table(value)) {
    std::vector<const json*> records;
    std::vector<std::string> names;
    for (const auto& [key, record] : value.items()) {
      records.push_back(&record);
      if (value.is_object()) names.push_back(key);
    }
    tables += fmt::format("\n## {}\n\n{}", title, table(records, names));
    return;
  }
  if (!value.is_object()) return;
  std::string line;
  for (const auto& [key, inner] : value.items())
    if (is_cell(inner)) line += (line.empty() ? "" : ", ") + words(key) + " " + cell(inner);
  if (!line.empty()) lines += fmt::format("- {}: {}\n", title, line);
  for (const auto& [key, inner] : value.items())
    if (!is_cell(inner) && !is_left_out(key)) add(lines, tables, title + ", " + words(key), inner);
}

// The words at the end that two snake_case names share: "ms_law_faded" of "0_ms_law_faded" and
// "50_ms_law_faded".
std::string common_end(const std::string& a, const std::string& b) {
  const auto [left, right] = std::mismatch(a.rbegin(), a.rend(), b.rbegin(), b.rend());
  const std::string end(left.base(), a.end());
  if ((left == a.rend() || *left == '_') && (right == b.rend() || *right == '_')) return end;
  const std::size_t bar = end.find('_');
  return bar == std::string::npos ? "" : end.substr(bar + 1);
}
std::string common_start(std::string a, std::string b) {
  std::reverse(a.begin(), a.end());
  std::reverse(b.begin(), b.end());
  std::string start = common_end(a, b);
  std::reverse(start.begin(), start.end());
  return start;
}

// Promises that are met, have the same bound, and whose names end alike by two words or more.
bool are_of_a_kind(const json& a, const json& b) {
  for (const json* t : {&a, &b})
    if (!t->at("met").get<bool>() || !t->at("value").is_number()) return false;
  for (const char* key : {"target", "unit", "at_most"})
    if (a.at(key) != b.at(key)) return false;
  return common_end(a.at("name"), b.at("name")).find('_') != std::string::npos;
}

std::string promise_row(const json& promise, const std::string& name) {
  std::string unit = promise.at("unit");
  unit = unit.empty() || unit == "1" ? "" : " " + unit;
  const std::string value = cell(promise.at("value")) + unit;
  return row({name, promise.at("met").get<bool>() ? value : "**" + value + ", not met**",
              (promise.at("at_most") ? "<= " : ">= ") + cell(promise.at("target")) + unit});
}

// One row for promises of a kind, with the figure of the worst.
std::string worst_row(const std::vector<const json*>& kind) {
  const auto is_better = [](const json* a, const json* b) {
    return a->at("at_most").get<bool>() ? a->at("value") < b->at("value") : a->at("value") > b->at("value");
  };
  std::string start = kind.front()->at("name"), end = start;
  for (const json* promise : kind) {
    start = common_start(start, promise->at("name"));
    end = common_end(end, promise->at("name"));
  }
  if (!start.empty()) start += '_';
  return promise_row(**std::max_element(kind.begin(), kind.end(), is_better),
                     fmt::format("{}..._{} (worst of {})", start, end, kind.size()));
}

std::string promised(const json& promises) {
  std::vector<std::vector<const json*>> kinds;
  for (const json& promise : promises) {
    const auto kind = std::find_if(kinds.begin(), kinds.end(), [&promise](const auto& other) {
      return are_of_a_kind(*other.front(), promise);
    });
    if (kind == kinds.end())
      kinds.push_back({&promise});
    else
      kind->push_back(&promise);
  }
  std::string text = head({"promise", "measured", "promised"});
  for (const auto& kind : kinds) {
    if (kind.size() >= kMinOfAKind)
      text += worst_row(kind);
    else
      for (const json* promise : kind) text += promise_row(*promise, promise->at("name"));
  }
  return text;
}

// ": AMD EPYC, 2 cores, teletact 0.1.0, 2026-11-21", as far as it is known.
std::string origin(const json& machine) {
  constexpr std::pair<const char*, const char*> kParts[] = {
      {"processor", "{}"}, {"cores", "{} cores"}, {"version", "teletact {}"}, {"date", "{}"}};
  std::string text;
  for (const auto& [key, format] : kParts)
    if (machine.contains(key))
      text += (text.empty() ? ": " : ", ") + fmt::format(fmt::runtime(format), cell(machine[key]));
  return text;
}

// One Markdown page: when, where and of which version; what was promised and measured; the smaller tables of
// the result. Throws BenchError when it is not the result of a suite.
std::string results_page(const json& result) try {
  std::string page =
      fmt::format("# Results of `teletact-bench {}`\n\nWritten by `teletact-bench report`{}.\n",
                  result.at("suite").get<std::string>(), origin(result.at("machine")));
  if (result.value("quick", false)) page += "\n**A quick run: to see that it works, not to quote.**\n";
  if (!result.at("targets").empty()) page += "\n## Promised and measured\n\n" + promised(result["targets"]);
  json rest = result;
  for (const char* key : {"suite", "machine", "targets", "quick"}) rest.erase(key);
  std::string lines, tables;
  for (const auto& [key, value] : rest.items())
    if (is_cell(value)) lines += fmt::format("- {}: {}\n", words(key), cell(value));
  for (const auto& [key, value] : rest.items())
    if (!is_cell(value) && !is_left_out(key)) add(lines, tables, words(key), value);
  if (!lines.empty()) page += "\n## Figures\n\n" + lines;
  return page + tables;
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
