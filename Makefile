# The few commands a person needs; CMake does the work. `make help` lists them.
PRESET ?= release
PREFIX ?= /usr/local
BUILD  := build/$(PRESET)
SUDO   := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: help setup build run test test-kernel test-long bench bench-vision asan tsan mutate mutate-numeric fuzz format format-check tidy install deb fresh check-scripts \
        format-scripts reference clean
help:            ## this list
	@grep -hE '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 16

setup:           ## install the Debian packages that are missing (packages.txt)
	@SUDO="$(SUDO)" sh cmake/install_packages.sh packages.txt

$(BUILD)/CMakeCache.txt: | setup
	cmake --preset $(PRESET)

build: setup $(BUILD)/CMakeCache.txt ## configure and build (PRESET=release|dev|asan|tsan)
	cmake --build --preset $(PRESET)

run: setup $(BUILD)/CMakeCache.txt ## drive the simulated microrobot round the square of the thesis' figure 6.5
	cmake --build --preset $(PRESET) --target vitreo
	$(BUILD)/vitreo run protocols/servo_square.lua

test: build      ## build and run every test
	ctest --preset $(PRESET)

test-kernel: setup $(BUILD)/CMakeCache.txt ## the programs on Debian's kernel in QEMU: real nodes, unplug, kills, sleep, panic (docs/real_kernel.md)
	@SUDO="$(SUDO)" sh cmake/install_packages.sh tests/kernel/packages.txt
	cmake --build --preset $(PRESET) --target kernel_guest_tests
	SUDO="$(SUDO)" python3 -B tests/kernel/run.py --build $(BUILD) --folder build/kernel

test-long: build ## the long forms: 200 kills, thousands of broken files; prints distributions
	ctest --test-dir $(BUILD) -C long -L long --verbose

bench: build     ## print the figures of the loop and of its parts
	sh tests/bench/run.sh $(BUILD)

bench-vision: build ## print the hard set: the color tracker before 12 grounds in 48 variants; wants python3-skimage, python3-opencv
	sh tests/bench/hard_set/run.sh $(BUILD)

asan:            ## every test under the address and undefined-behavior sanitizers
	$(MAKE) test PRESET=asan

tsan:            ## every test under the thread sanitizer
	$(MAKE) test PRESET=tsan

mutate: setup $(BUILD)/CMakeCache.txt ## mutants of the safety code against their tests: 95 % must be killed (15 minutes)
	cmake --build $(BUILD) --target mutants
	python3 -B tests/mutation/mutate.py $(BUILD)/tests/mutation

mutate-numeric: build ## the same of the numeric code and of the record: 90 % must be killed, 95 % of what moves the coils
	cmake --build $(BUILD) --target numeric_mutants
	python3 -B tests/mutation/mutate.py $(BUILD)/tests/mutation --numeric

SECONDS ?= 30
fuzz: setup      ## feed every parser of outside bytes with random ones (SECONDS=30 each, or EXECUTIONS=100000000; clang)
	cmake --preset fuzz
	cmake --build build/fuzz --target fuzzers
	sh tests/fuzz/run.sh build/fuzz/tests/fuzz $(SECONDS) $(EXECUTIONS)

SOURCES = $(shell git ls-files -co --exclude-standard '*.cpp' '*.h')
format:          ## lay out the C++ sources
	@clang-format -i $(SOURCES)
format-check:    ## fail where the layout differs
	@clang-format --dry-run --Werror $(SOURCES)
tidy: setup      ## clang-tidy over our own sources (an hour and a half on 2 cores); not by the release's commands, whose precompiled headers are gcc's
	cmake --preset dev
	python3 -B cmake/tidy.py build/dev

install: build   ## install program, scripts, docs, man page, completion, udev rules (PREFIX=/usr/local)
	$(SUDO) cmake --install $(BUILD) --prefix $(PREFIX)

deb: build       ## the Debian packages: build/release/vitreo_VERSION_ARCH.deb, vitreo-doc and python3-vitreo_VERSION_all.deb
	cd $(BUILD) && cpack -G DEB
	sh packaging/doc_package.sh $(BUILD) $$(sed -n 's/^project(vitreo VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
	sh packaging/python_package.sh $(BUILD) $$(sed -n 's/^project(vitreo VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)

fresh: ## prove the README's two commands in a fresh Debian 12 folder (root, network, half an hour)
	sh packaging/fresh.sh

SCRIPTS = $(shell git ls-files -co --exclude-standard 'protocols/*.lua' 'scripts/*.lua' 'templates/*.lua')
STYLUA = $(BUILD)/tests/page
$(STYLUA)/node_modules: tests/page/package-lock.json
	mkdir -p $(STYLUA) && cp tests/page/package.json tests/page/package-lock.json $(STYLUA)
	npm --prefix $(STYLUA) ci --ignore-scripts --no-audit --no-fund --silent && touch $@
check-scripts: $(STYLUA)/node_modules ## luacheck, with the names that scripts can see, and StyLua (wants node and npm)
	$(BUILD)/vitreo docs luacheck > $(BUILD)/luacheckrc && luacheck --config $(BUILD)/luacheckrc -q $(SCRIPTS)
	node cmake/format_scripts.cjs $(CURDIR)/$(STYLUA) --check $(SCRIPTS)
format-scripts: $(STYLUA)/node_modules ## lay out the Lua scripts with StyLua
	node cmake/format_scripts.cjs $(CURDIR)/$(STYLUA) $(SCRIPTS)
docs:            ## the docs as a site with search, to be read without a network: build/docs/index.html
	python3 cmake/docs_site.py . build/docs
reference:       ## print docs/api.md and the golden help texts anew from the program
	sh tests/program/print_golden.sh $(BUILD)/vitreo

clean:           ## remove the build folders
	rm -rf build
