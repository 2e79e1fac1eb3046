import"./chunk-VSDYETHS.js";import{O as e,y as t}from"./chunk-ZJKHKGPO.js";function a(){return t(e,{title:"Calibrate",text:"This page is being built."})}export{a as Calibrate};
