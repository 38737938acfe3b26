"""Table of all commands, keyed by group: name, location of the function, and one line of help.

A command is loaded when it runs or shows its help, so that `solen --help` loads no large modules. To add a command,
write its function in `solen.pipeline`, a module in the folder of its group that imports it and prints its result, and a
row here.
"""

DESIGN, RESIN, PRINT, BENCH, EXPLORE, PROJECT = "", "resin", "print", "bench", "explore", "project"

GROUPS = {
    RESIN: "Characterise a resin: index, loss, cure and stiffness from the exports of instruments.",
    PRINT: "Print and inspect: layers, coupons, predicted and measured lenses.",
    BENCH: "Record, analyse and calibrate sensors on a real or a simulated bench.",
    EXPLORE: "Explore designs: sweeps over their parameters, tolerances, inverse design.",
    PROJECT: "Projects: sample data for every command, archives to share, the figures of the paper.",
}

COMMANDS: dict[str, tuple[tuple[str, str, str], ...]] = {
    DESIGN: (
        ("new", "design.new:new", "Write a commented design file, FOLDER/sensor.toml."),
        (
            "check",
            "design.check:check",
            "Check a design at every angle of its motion, or check a scene.",
        ),
        ("run", "design.run:run", "Simulate a design: response with and without lens, figures, tables, report."),
        ("trace", "design.trace:trace", "Trace a design at one angle, or a scene (.json, also of ray-optics)."),
        ("deform", "design.deform:deform", "Show a soft body under load: shape, strain, forces, moments."),
        ("lens", "design.check:lens", "Show the lens of a design: shape, acceptance, magnification, focus."),
        ("sensitivity", "design.sensitivity:sensitivity", "Rank the parameters of a design by their effect."),
        ("convergence", "design.sensitivity:convergence", "Show how the error decreases with the number of rays."),
        (
            "readout",
            "design.readout:readout",
            "Show receiver voltages over the motion, their noise, and the recommended load.",
        ),
        ("studio", "design.studio:studio", "Show a design in the browser: drag its parts, and see rays and response."),
        ("export", "design.export:export", "Write the solid and drawings of a sensor: STL, 3MF, STEP, DXF, SVG."),
        ("schema", "design.schema:schema", "Print the JSON Schema of the design file, or of the result of a command."),
        ("doctor", "design.doctor:doctor", "Check the installation, and print the information for a bug report."),
        ("completion", "design.doctor:completion", "Install completion of commands and options in the shell."),
    ),
    RESIN: (
        ("spectra", "resin.spectra:spectra", "List the spectra in a file: quantities, units, wavelengths."),
        ("index", "resin.index:index", "Compute the index of a printed layer from its R and T spectra."),
        ("refractometer", "resin.refractometer:refractometer", "Extend a measured index to other wavelengths."),
        ("cutback", "resin.cutback:cutback", "Compute the loss of a guide in dB/cm from several lengths."),
        ("cure", "resin.cure:cure", "Fit the working curve of a resin, Dc = Dp ln(E/Ec)."),
        ("penetration", "resin.penetration:penetration", "Compute the penetration depth from an absorbance spectrum."),
        ("exposures", "resin.exposures:exposures", "Compare the transmittance of layers with different exposures."),
        ("stiffness", "resin.stiffness:stiffness", "Fit modulus and hyperelastic models to mechanical tests."),
        ("build", "resin.library:build", "Write a resin file from the results of other commands."),
        ("mix", "resin.library:mix", "Compute the amounts to weigh in for a mixture."),
        ("list", "resin.library:list_", "List the resins shipped with solen."),
        ("show", "resin.library:show", "Show a resin and its index at given wavelengths."),
    ),
    PRINT: (
        ("layers", "print.layers:layers", "Slice a design or a mesh into layers for a printer."),
        ("coupons", "print.coupons:coupons", "Write coupons that test a printer and a resin."),
        ("fidelity", "print.fidelity:fidelity", "Measure a printed coupon in an image or a height map."),
        ("calibrate", "print.calibrate:calibrate", "Fit the blur, growth and shrinkage of a printer to coupons."),
        ("grey", "print.grey:grey", "Measure the transmission of grey pixels, from cured discs."),
        (
            "predict",
            "print.predict:predict",
            "Predict the printed lens of a design, and the resulting loss of response.",
        ),
        ("scale", "print.scale:scale", "Measure the scale of an objective in an image of a stage micrometer."),
        ("inspect", "print.inspect:inspect", "Measure a printed lens in a micrograph, and compare it with its design."),
        ("tune", "print.tune:tune", "Correct the drawing of a lens from an image of its print, print by print."),
        ("printers", "print.layers:printers", "List the printers that solen supports."),
    ),
    BENCH: (
        ("new", "bench.record:new", "Write example protocols and rigs into a folder."),
        ("firmware", "bench.firmware:firmware", "Write the firmware of an emitter board: Pico, ESP32 or Arduino Uno."),
        ("check", "bench.look:check", "Check a rig before a run: wiring, emitters, clipping, noise, trimmers."),
        ("watch", "bench.look:watch", "Show live readings of the receivers of a rig."),
        ("jog", "bench.look:jog", "Move the stage of a rig, within its travel."),
        ("run", "bench.record:run", "Run a protocol on a rig, real or simulated, and record it."),
        ("recover", "bench.record:recover", "Convert the journal of an interrupted run to a recording."),
        ("recordings", "bench.record:recordings", "List the recordings in a folder."),
        ("video", "bench.video:video", "Measure the angle of a marker in a video, and write a motion log."),
        ("demodulate", "bench.demodulate:demodulate", "Subtract ambient light from a switched recording."),
        ("analyse", "bench.analyse:analyse", "Compute cycles, response curves and figures of merit."),
        ("diagnose", "bench.diagnose:diagnose", "Estimate decentre, chip width, loss and gains."),
        ("calibrate", "bench.decode:calibrate", "Calibrate sensors: from voltages to angles."),
        ("decode", "bench.decode:decode", "Decode angles from voltages, from a file or live."),
        ("table", "bench.decode:table", "Write a calibration as code for a microcontroller."),
    ),
    EXPLORE: (
        ("sweep", "explore.sweep:sweep", "Trace a design over ranges of its parameters: merits and responses."),
        (
            "tolerance",
            "explore.tolerance:tolerance",
            "Trace random variations of a print: yield, and the parameters that limit it.",
        ),
        ("optimise", "explore.optimise:optimise", "Search for the design parameters that optimise a figure of merit."),
    ),
    PROJECT: (
        ("examples", "project.examples:examples", "Copy sample data for every command, all simulated, into a folder."),
        (
            "pack",
            "project.archive:pack",
            "Pack the files of a sensor into one archive, with description and checksums.",
        ),
        ("unpack", "project.archive:unpack", "Check and unpack an archive of a sensor that was received."),
        (
            "reproduce",
            "project.reproduce:reproduce",
            "Reproduce the figures of the paper, and compare its values with those of solen.",
        ),
    ),
}
