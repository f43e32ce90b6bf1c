// The page that builds commands: a select for each choice; each block of code below takes its form with what is chosen.
document.querySelectorAll("form[data-builder]").forEach((form) => {
  const {task, noise, filter} = JSON.parse(form.dataset.choices), selects = {}

  const fill = (name, values) => {
    const before = selects[name].value, shown = (value) => value.replace("turtlebot_gym/", "")
    selects[name].replaceChildren(...(values.length ? values : ["none"]).map((value) => new Option(shown(value), value)))
    if (values.includes(before)) selects[name].value = before
    selects[name].disabled = !values.length
  }

  const write = () => {
    const chosen = task[selects.task.value]
    for (const name of ["policy", "world"]) fill(name, chosen[name])
    for (const [name, text] of Object.entries(chosen.forms)) {
      const title = [...document.querySelectorAll(".highlight .filename")].find((each) => each.textContent === name)
      const told = text.replace(/{(\w+)}/g, (_, choice) => selects[choice].value)
      title.parentElement.querySelector("code").textContent = told || `# ${selects.task.value}: choose the square, rooms or missions`
    }
  }

  for (const name of ["task", "noise", "filter", "policy", "world"]) {
    selects[name] = Object.assign(document.createElement("select"), {name, onchange: write})
    const label = document.createElement("label")
    label.append(name, selects[name])
    form.append(label)
  }
  fill("task", Object.keys(task))
  fill("noise", noise)
  fill("filter", filter)
  selects.noise.value = "tutorial"
  write()
  selects.policy.value = "bearing"
  write()
})
