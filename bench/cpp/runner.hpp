// What the runners in C++ share: the arguments, the arrays, the clock and the line of JSON (see bench/README.md).
#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace bench {

struct Arguments {
  std::string named;  // the library
  std::string version;
  std::string stage;
  std::filesystem::path inputs;
  std::filesystem::path out;
  int threads = 1;
  int repeat = 1;
  std::FILE* lines = stdout;  // where the line of JSON goes

  std::filesystem::path file(const std::string& name) const { return inputs / name; }
};

struct Stage {
  std::string name;
  void (*run)(const Arguments&);
};

struct Output {
  std::vector<char> bytes;
  std::size_t count = 0;  // of things that came out; 0 for a pose
};

template <class T>
Output output(const std::vector<T>& values, std::size_t count) {
  static_assert(std::is_arithmetic_v<T>);
  const auto* first = reinterpret_cast<const char*>(values.data());
  return {{first, first + values.size() * sizeof(T)}, count};
}

inline std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  return {std::istreambuf_iterator<char>(file), {}};
}

// A raw little-endian array, as every machine that this runs on stores it.
template <class T>
std::vector<T> array(const std::filesystem::path& path) {
  static_assert(std::is_arithmetic_v<T>);
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw std::runtime_error("cannot read " + path.string());
  const auto bytes = static_cast<std::size_t>(file.tellg());
  if (bytes % sizeof(T) != 0) throw std::runtime_error(path.string() + ": a part of a number at the end");
  std::vector<T> values(bytes / sizeof(T));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(bytes));
  if (!file) throw std::runtime_error("cannot read " + path.string());
  return values;
}

// One number of `settings.json`, which is a flat object of numbers.
inline double setting(const Arguments& args, const std::string& name) {
  const std::string text = text_of(args.file("settings.json"));
  const auto key = text.find('"' + name + '"');
  const auto colon = key == std::string::npos ? key : text.find(':', key);
  if (colon == std::string::npos) throw std::runtime_error("settings.json has no \"" + name + '"');
  const char* from = text.c_str() + colon + 1;
  char* end = nullptr;
  const double value = std::strtod(from, &end);
  if (end == from) throw std::runtime_error("settings.json: \"" + name + "\" is no number");
  return value;
}

// User and system time of all threads of the process so far, seconds.
inline double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// "VmRSS" or "VmHWM" of the process, bytes.
inline std::size_t memory(const std::string& what) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(what + ':', 0) == 0) return std::stoull(line.substr(what.size() + 1)) * 1024;
  }
  throw std::runtime_error("/proc/self/status has no " + what);
}

inline void forget_memory_peak() { std::ofstream("/proc/self/clear_refs") << 5; }

inline std::string quoted(const std::string& text) {
  std::string json = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') json += '\\';
    json += c;
  }
  return json + '"';
}

inline std::string list(const std::vector<double>& values) {
  std::ostringstream json;
  json << std::setprecision(9) << '[';
  for (std::size_t i = 0; i < values.size(); ++i) json << (i == 0 ? "" : ", ") << values[i];
  json << ']';
  return json.str();
}

// Runs `work` once to warm up and then as often as asked, timed, and prints the line. A result is let go of before the next run starts,
// outside the clock. `show` makes an `Output` of the last result.
template <class Work, class Show>
void measure(const Arguments& args, const std::string& note, Work work, Show show) {
  std::optional<std::invoke_result_t<Work>> result;
  std::vector<double> wall, cpu;
  forget_memory_peak();
  const std::size_t before = memory("VmRSS");
  result.emplace(work());
  for (int i = 0; i < args.repeat; ++i) {
    result.reset();
    const double cpu_start = cpu_seconds();
    const auto start = std::chrono::steady_clock::now();
    result.emplace(work());
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    cpu.push_back(cpu_seconds() - cpu_start);
    wall.push_back(taken.count());
  }
  const std::size_t peak = memory("VmHWM");
  const Output shown = show(*result);
  if (!args.out.empty()) {
    std::ofstream file(args.out, std::ios::binary);
    file.write(shown.bytes.data(), static_cast<std::streamsize>(shown.bytes.size()));
    if (!file.flush()) throw std::runtime_error("cannot write " + args.out.string());
  }
  std::ostringstream line;
  line << "{\"library\": " << quoted(args.named) << ", \"version\": " << quoted(args.version)
            << ", \"stage\": " << quoted(args.stage) << ", \"input\": " << quoted(args.inputs.filename().string())
            << ", \"threads\": " << args.threads << ", \"wall\": " << list(wall) << ", \"cpu\": " << list(cpu)
            << ", \"rss_before\": " << before << ", \"rss_peak\": " << peak << ", \"count\": " << shown.count
            << ", \"note\": " << quoted(note) << "}\n";
  std::fputs(line.str().c_str(), args.lines);
}

inline Arguments arguments(int argc, char** argv) {
  Arguments args;
  const auto number = [](const std::string& name, const char* value) {
    char* end = nullptr;
    const long n = std::strtol(value, &end, 10);
    if (end == value || *end != '\0' || n < 1 || n > 1'000'000) throw std::runtime_error(name + " wants a number from 1 on");
    return static_cast<int>(n);
  };
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc) throw std::runtime_error(name + ": no value");
    const char* value = argv[i + 1];
    if (name == "--library") args.named = value;
    else if (name == "--inputs") args.inputs = std::filesystem::canonical(value);
    else if (name == "--stage") args.stage = value;
    else if (name == "--threads") args.threads = number(name, value);
    else if (name == "--repeat") args.repeat = number(name, value);
    else if (name == "--out") args.out = value;
    else throw std::runtime_error(name + ": no such argument");
  }
  return args;
}

inline int run(int argc, char** argv, const std::string& library, const std::string& version, const std::vector<Stage>& stages) {
  try {
    if (argc == 2 && std::strcmp(argv[1], "--stages") == 0) {
      for (const Stage& stage : stages) std::cout << library << ' ' << stage.name << '\n';
      return 0;
    }
    Arguments args = arguments(argc, argv);
    if (args.named != library) throw std::runtime_error("--library: this runner has " + library);
    if (args.inputs.empty()) throw std::runtime_error("--inputs: which folder?");
    args.version = version;
    // What the libraries have to say to standard output goes to the errors: the line of JSON has it to itself.
    args.lines = fdopen(dup(STDOUT_FILENO), "w");
    dup2(STDERR_FILENO, STDOUT_FILENO);
    for (const Stage& stage : stages) {
      if (stage.name == args.stage) {
        stage.run(args);
        return std::fclose(args.lines) == 0 ? 0 : 1;
      }
    }
    throw std::runtime_error("--stage: --stages tells what this runner has");
  } catch (const std::exception& error) {
    std::cerr << "bench: " << error.what() << '\n';
    return 1;
  }
}

}  // namespace bench
