import"./chunk-VSDYETHS.js";import{O as t,y as i}from"./chunk-ZJKHKGPO.js";function n(){return i(t,{title:"Train",text:"This page is being built."})}export{n as Train};
